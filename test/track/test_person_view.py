"""A person of a frame: their points and windows, and what others are to them."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.labels import BACKGROUND, PERSON, UNKNOWN
from depth_pose.track.person_view import MIN_POINTS, thin, thin_image


def pixels_of(window, camera, value):
    """Rows and columns of the whole image where a window says a value."""
    rows, columns = np.nonzero(window.labels == value)
    z = np.ones(len(rows))
    c = window.camera
    rays = np.stack([(columns - c.cx) / c.fx, (rows - c.cy) / c.fy, z], axis=1)
    at = camera.project(rays)
    np.testing.assert_allclose(at, np.rint(at), atol=1e-9)  # a window's pixels are the image's
    columns, rows = np.rint(at).astype(int).T
    return rows, columns


@pytest.fixture(scope="module")
def drawn():
    return syn.draw(syn.mesh(syn.posed(syn.arms_down())))


def test_points_and_windows_are_the_person_s(drawn):
    people = syn.to_people(drawn)
    (person,) = people.persons
    mine = people.labels == PERSON
    np.testing.assert_array_equal(person.points, people.points[mine].astype(np.float64))
    assert person.camera == people.camera == syn.CAMERA
    for window, share in ((person.full, 1.0), (person.coarse, 0.25)):
        assert (window.camera.height, window.camera.width) == window.depth.shape == window.labels.shape
        at = pixels_of(window, syn.CAMERA, PERSON)
        depth = window.depth[window.labels == PERSON]
        np.testing.assert_array_equal(drawn[at].astype(np.float32), depth)
        assert len(depth) == pytest.approx(share * mine.sum(), rel=0.1)
        assert not window.depth[window.labels != PERSON].any()


def test_points_project_to_where_the_window_has_them(drawn):
    (person,) = syn.to_people(drawn).persons
    rows, columns = np.nonzero(person.full.labels == PERSON)
    at = person.full.camera.project(person.points)
    np.testing.assert_allclose(at, np.stack([columns, rows], axis=1), atol=1e-4)
    np.testing.assert_array_equal(person.points[:, 2].astype(np.float32), person.full.depth[rows, columns])


def two(gap, aside=0.25):
    """Two who overlap in the image, the second ``gap`` metres farther."""
    near = syn.draw(syn.mesh(syn.posed(syn.arms_down(), distance=2.6)))
    far = syn.draw(syn.mesh(syn.posed(syn.arms_down(), distance=2.6 + gap, aside=aside)))
    return near, far


def test_who_is_nearer_hides_and_who_is_farther_is_free_space():
    near, far = two(1.2)
    people = syn.to_people(near, far)
    first, second = people.persons
    assert (first.body_id, second.body_id) == ("body_1", "body_2")
    for person, number, other, said in ((first, 1, 2, BACKGROUND), (second, 2, 1, UNKNOWN)):
        for window in (person.full, person.coarse):
            assert (people.labels[pixels_of(window, people.camera, PERSON)] == number).all()
            at = pixels_of(window, people.camera, said)
            assert (people.labels[at] == other).sum() > 50
            wrong = pixels_of(window, people.camera, BACKGROUND + UNKNOWN - said)
            assert not (people.labels[wrong] == other).any()
    covered = np.isfinite(near) & np.isfinite(far)
    assert covered.sum() > 200
    assert len(second.points) == np.isfinite(far).sum() - covered.sum()


def test_beside_each_other_each_may_hide_the_other():
    """Who is level with a person, or a hand's breadth behind, may have a limb before them."""
    people = syn.to_people(*two(0.0, aside=0.55))
    for person, other in zip(people.persons, (2, 1), strict=True):
        at = pixels_of(person.full, people.camera, BACKGROUND)
        assert not (people.labels[at] == other).any()
        assert (people.labels[pixels_of(person.full, people.camera, UNKNOWN)] == other).any()


def test_a_person_alone_looks_the_same_beside_somebody_who_is_free_space(drawn):
    """Somebody farther, seen or not, changes nothing of the nearer one."""
    near, far = two(1.2)
    (alone,), (first, _) = syn.to_people(near).persons, syn.to_people(near, far).persons
    np.testing.assert_array_equal(first.points, alone.points)
    for a, b in ((first.full, alone.full), (first.coarse, alone.coarse)):
        np.testing.assert_array_equal(a.labels, b.labels)
        np.testing.assert_array_equal(a.depth, b.depth)
        assert a.camera == b.camera


def test_what_nothing_is_known_of_is_unknown_to_everybody():
    near, far = two(1.2)
    post = np.zeros(near.shape, bool)
    post[:, 86:90] = True
    people = syn.to_people(near, far, hidden=post)
    for person in people.persons:
        assert not np.isin(pixels_of(person.full, people.camera, PERSON)[1], range(86, 90)).any()
        columns = pixels_of(person.full, people.camera, UNKNOWN)[1]
        assert {86, 87, 88, 89} <= set(columns.tolist())


def test_who_has_too_few_points_is_not_among_the_persons(drawn):
    rows, columns = np.nonzero(np.isfinite(drawn))
    for count, seen in ((MIN_POINTS - 1, 0), (MIN_POINTS, 1)):
        few = np.full(drawn.shape, np.inf)
        few[rows[:count], columns[:count]] = drawn[rows[:count], columns[:count]]
        people = syn.to_people(few)
        assert len(people.persons) == seen
        assert (people.labels == 1).sum() == count
    other = np.full(drawn.shape, np.inf)
    other[5:9, 5:9] = 3.0
    assert [p.body_id for p in syn.to_people(other, drawn).persons] == ["body_2"]


def test_nobody_and_a_found_one_without_a_pixel(drawn):
    assert syn.to_people().persons == ()
    assert [p.body_id for p in syn.to_people(drawn, np.full(drawn.shape, np.inf)).persons] == ["body_1"]


def test_thinned_images_keep_every_nth_pixel(drawn):
    (person,) = syn.to_people(drawn).persons
    thinned = thin_image(person.full, 3.0, 0.05)
    step = int(0.05 * syn.CAMERA.fx / 3.0)
    assert step == 3
    np.testing.assert_array_equal(thinned.depth, person.full.depth[::3, ::3])
    np.testing.assert_array_equal(thinned.labels, person.full.labels[::3, ::3])
    ray = np.array([(12 - person.full.camera.cx) / person.full.camera.fx, 0.1, 1.0])
    assert thinned.camera.project(ray)[0] == pytest.approx(4.0)  # the twelfth column
    assert thin_image(person.full, 3.0, 0.02) is person.full


def test_a_view_prepares_everything_once(drawn):
    (person,) = syn.to_people(drawn).persons
    assert person.target(300) is person.target(300)
    assert len(person.target(300).points) == 300
    assert person.target(10**6) is person.target(len(person.points))
    assert person.target(300).nearest is person.target(500).nearest
    assert person.thinned(0.08) is person.thinned(0.08)
    assert person.thinned(0.08).depth.size < person.coarse.depth.size
    assert person.comparer.nearest is person.comparer.nearest
    assert len(person.target(300, with_proposals=False).proposals.nodes) == 0


def test_thin():
    points = np.arange(30.0).reshape(10, 3)
    np.testing.assert_array_equal(thin(points, 10), points)
    np.testing.assert_array_equal(thin(points, 5), points[::2])
    assert len(thin(points, 3)) == 3
