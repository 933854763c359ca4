"""What people rest on meets their skin, covers count as the person, hands hold what helps them walk."""

import numpy as np
import pytest

from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.sim._meshes import blob
from depth_pose.sim.people import HANDS_M, sample_figure
from depth_pose.sim.reliefs import CELL_M, Plane, cover, press, spread
from depth_pose.sim.resting import SEATS, child_in_arms, hands_of, settle
from depth_pose.sim.shapes import Kind, triangulate

UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
PLANE = Plane(np.array([-0.6, 0.0, -0.45]), UP, (31, 41))
"""A level plane at height 0."""


def ball(height, radius=0.15):
    vertices, faces = blob(np.full(3, radius))
    return vertices + [0.0, height, 0.0], faces


def away():
    """Distance of each cell from the middle, metres."""
    return np.linalg.norm(PLANE.points(np.zeros(PLANE.shape))[..., [0, 2]], axis=-1)


def seated(rng):
    while True:
        figure = sample_figure(rng, "sit")
        if figure.seat_height > 0:
            return figure


def lying(rng, raised=True):
    while True:
        figure = sample_figure(rng, "lie")
        if (figure.seat_height > 0) == raised:
            return figure


def triangles(things, rng):
    return [triangulate(thing, rng) for thing in things]


def gap(points, made):
    """Distance of each point from the nearest of a mesh's vertices and triangle middles, metres."""
    anchors = np.concatenate([made.vertices, made.vertices[made.faces].mean(axis=1)])
    return np.linalg.norm(points[:, None] - anchors[None], axis=-1).min(axis=1)


def test_heights_are_those_of_the_mesh():
    above, below = (PLANE.heights(*ball(0.5), below=b) for b in (False, True))
    middle = np.unravel_index(away().argmin(), PLANE.shape)
    assert above[middle] == pytest.approx(0.65, abs=0.005)
    assert below[middle] == pytest.approx(0.35, abs=0.005)
    assert np.isnan(above[away() > 0.16]).all()
    assert np.isfinite(above[away() < 0.12]).all()


def test_a_slope_is_no_steeper_than_asked_for_and_hides_no_bump():
    bump = np.where(away() < 0.1, 0.2, 0.0)
    wide = spread(bump, 1.0)
    assert np.abs(np.diff(wide, axis=0)).max() < 1.1 * CELL_M
    assert wide[away() < 0.05].min() > 0.15
    assert wide[away() > 0.45].max() < 0.01


def test_a_cushion_gives_way_where_a_body_lies_in_it_and_only_there():
    vertices, faces = ball(0.05)
    rest = np.zeros(PLANE.shape)
    surface = press(PLANE, rest, vertices, faces, 1.5)
    under = PLANE.heights(vertices, faces, below=True)
    touched = under < 0
    assert (surface[touched] < under[touched] + 0.035).all()
    assert np.abs(surface[away() > 0.35]).max() < 1e-3
    hovers = press(PLANE, rest, *ball(0.3), 1.5)
    np.testing.assert_array_equal(hovers, rest)


def test_a_sheet_lies_over_the_body_and_is_the_person_only_there():
    vertices, faces = ball(0.1)
    laid = cover(np.random.default_rng(0), PLANE, np.zeros(PLANE.shape), vertices, faces)
    on = away() < 0.1
    assert (laid.points[on][:, 1] > PLANE.heights(vertices, faces)[on] - 0.05).all()
    assert (laid.points[..., 1] > -1e-9).all()
    theirs = np.linalg.norm(laid.person[0][:, [0, 2]], axis=1)
    assert theirs.max() < 0.5 and len(laid.person[1]) > 50
    assert laid.person[1].max() < len(laid.person[0])


def test_who_lies_in_bed_lies_on_it_and_may_be_covered():
    covered = 0
    for k in range(12):
        rng = np.random.default_rng([3, k])
        figure = lying(rng)
        settled = settle(figure, rng)
        (made,) = triangles(settled.things, rng)
        np.testing.assert_array_equal(settled.figure.joints, figure.joints)
        np.testing.assert_array_equal(settled.figure.vertices[: len(figure.vertices)], figure.vertices)
        low = figure.vertices[figure.vertices[:, 1] < np.quantile(figure.vertices[:, 1], 0.03)]
        assert np.median(gap(low, made)) < 0.06
        extra = settled.figure.vertices[len(figure.vertices) :]
        covered += len(extra) > 0
        if len(extra):  # it lies over them: no lower than the bed, near the body, as high as the body reaches
            assert extra[:, 1].min() > figure.seat_height - 0.2
            assert gap(extra, triangulate_body(figure)).max() < 0.5
    assert 3 <= covered <= 11


def triangulate_body(figure):
    """Build a body with the attributes that `gap` needs."""

    class Body:
        vertices, faces = figure.vertices, figure.faces

    return Body


def test_some_on_the_floor_are_covered_and_their_sheet_lies_on_it():
    sheets = 0
    for k in range(20):
        rng = np.random.default_rng([4, k])
        settled = settle(lying(rng, raised=False), rng)
        for made in triangles(settled.things, rng):
            sheets += 1
            assert made.vertices[:, 1].min() > -0.05
    assert 1 <= sheets < 15


@pytest.mark.parametrize("seat", list(SEATS))
def test_seats_are_under_those_who_sit_on_them(seat):
    for k in range(6):
        rng = np.random.default_rng([5, k])
        figure = seated(rng)
        settled = settle(figure, rng, seat)
        made = triangles(settled.things, rng)[0]
        hips = figure.joints[[JOINT_INDEX["left_hip"], JOINT_INDEX["right_hip"]]].astype(float)
        bottom = figure.vertices[np.abs(figure.vertices[:, 1] - figure.seat_height) < 0.03].astype(float)
        bottom = bottom[np.linalg.norm(bottom[:, [0, 2]] - hips.mean(axis=0)[[0, 2]], axis=1) < 0.2]
        spot = hips.mean(axis=0)[[0, 2]]
        assert (made.vertices[:, [0, 2]].min(axis=0) < spot).all()
        assert (made.vertices[:, [0, 2]].max(axis=0) > spot).all()
        assert abs(made.vertices[:, 1] - figure.seat_height).min() < 0.15
        if seat == "sofa":
            assert np.median(gap(bottom, made)) < 0.05
            assert (settled.table == 0) and (made.kind == Kind.SOFA).all()


def test_backs_touch_the_cushion_behind_them():
    touching = []
    for k in range(10):
        rng = np.random.default_rng([6, k])
        figure = seated(rng)
        made = triangles(settle(figure, rng, "sofa").things, rng)[0]
        chest, pelvis = (figure.joints[JOINT_INDEX[n]] for n in ("chest", "pelvis"))
        trunk = figure.vertices[(figure.vertices[:, 1] > pelvis[1]) & (figure.vertices[:, 1] < chest[1])]
        behind = trunk[trunk[:, 2] < np.quantile(trunk[:, 2], 0.03)].astype(float)
        touching.append(gap(behind, made).min() < 0.06)
    assert sum(touching) >= 8


def test_hands_hold_walking_frames_and_crutches_and_these_stand_on_the_floor():
    for doing in ("frame", "crutches"):
        for k in range(6):
            rng = np.random.default_rng([7, k])
            figure = sample_figure(rng, "stand", doing=doing)
            made = triangles(settle(figure, rng).things, rng)
            assert min(gap(hands_of(figure), m).min() for m in made) < 0.06
            assert all(-0.03 < m.vertices[:, 1].min() < 0.12 for m in made)
            assert all((m.kind == Kind.AID).all() for m in made)


def test_children_in_arms_are_small_and_at_the_hands_of_an_adult():
    for k in range(6):
        rng = np.random.default_rng([8, k])
        figure = sample_figure(rng, "stand", doing="child")
        child = child_in_arms(figure, rng)
        assert 0.5 < child.stature < 1.0
        assert child.vertices[:, 1].max() - child.vertices[:, 1].min() < 0.95
        hands = hands_of(figure)
        assert np.linalg.norm(child.vertices[:, None] - hands[None], axis=-1).min() < 0.15
    assert child_in_arms(sample_figure(np.random.default_rng(0), "sit"), np.random.default_rng(0)) is None


def test_those_with_aids_and_children_are_drawn_by_themselves():
    rng = np.random.default_rng(9)
    doing = [sample_figure(rng, "walk").doing for _ in range(150)]
    assert set(HANDS_M) <= set(doing)
    assert 8 < sum(d in HANDS_M for d in doing) < 45
