"""Cutting the person out of scenes whose pixels are known."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.labels import BACKGROUND, HIDDEN, PERSON
from depth_pose.detect import _surface_kernels as kernels
from depth_pose.detect.plane_segmenter import PlaneSegmenter
from depth_pose.detect.working_grid import reduce_camera


def segment(depth, camera=syn.CAMERA, **settings):
    return PlaneSegmenter(SegmentConfig(**settings)).segment(syn.to_frame(depth, camera=camera))


def recall(segmentation, truth):
    return ((segmentation.labels == PERSON) & truth).sum() / truth.sum()


def precision(segmentation, truth):
    person = segmentation.labels == PERSON
    return (person & truth).sum() / max(1, person.sum())


@pytest.fixture(scope="module")
def person():
    return syn.draw(syn.mesh(syn.posed(syn.arms_down())))


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("background", ["none", "wall", "floor and wall"])
def test_person_is_found_before_any_background(person, background, noise):
    scene = {"none": np.full_like(person, np.inf), "wall": syn.room(floor=50.0), "floor and wall": syn.room()}
    depth = np.minimum(person, scene[background])
    depth += noise * np.random.default_rng(0).standard_normal(depth.shape)
    found = segment(depth)
    truth = np.isfinite(person)
    assert recall(found, truth) > 0.95  # the soles are the floor's
    assert precision(found, truth) > 0.99
    np.testing.assert_array_equal(found.depth > 0, found.labels == PERSON)
    np.testing.assert_allclose(found.depth[found.depth > 0], depth[found.depth > 0], rtol=1e-6)


@pytest.mark.parametrize(("pitch", "roll"), [(25.0, 0.0), (0.0, 20.0), (-15.0, -15.0)])
def test_tilted_camera(pitch, roll):
    """Floor and wall are found by their size, not by where they lie."""
    turn = syn.rotation("z", roll) @ syn.rotation("x", pitch)
    body = syn.posed(syn.arms_down(), distance=3.2)
    aim = np.array([0.0, 0.0, 3.2])
    vertices = (body.vertices - aim) @ turn.T + aim
    person = syn.draw((vertices, syn.default_body().faces))
    planes = np.full(person.shape, np.inf)
    for normal, spot in (([0.0, 1.0, 0.0], [0.0, 0.9, 3.2]), ([0.0, 0.0, 1.0], [0.0, 0.0, 4.8])):
        n, p = turn @ normal, turn @ (np.array(spot) - aim) + aim
        planes = np.minimum(planes, syn.draw_plane(n, n @ p))
    found = segment(np.minimum(person, planes))
    truth = np.isfinite(person)
    assert recall(found, truth) > 0.93
    assert precision(found, truth) > 0.98


def test_furniture_beside_the_person_is_left_out(person):
    stool = syn.box([0.7, 0.45, 3.1], [1.1, 0.9, 3.5])
    board = syn.box([-1.5, 0.3, 3.8], [-1.0, 0.9, 4.2])
    others = syn.draw(stool, board)
    found = segment(np.minimum(np.minimum(person, others), syn.room()))
    truth = person < others
    assert recall(found, truth) > 0.95
    assert precision(found, truth) > 0.99


def test_a_cupboard_larger_than_the_person(person):
    """It fills its bounding box; a person does not."""
    cupboard = syn.draw(syn.box([-1.45, -0.3, 3.2], [-0.75, 0.9, 3.8]))
    found = segment(np.minimum(np.minimum(person, cupboard), syn.room()))
    truth = person < cupboard
    assert recall(found, truth) > 0.95
    assert precision(found, truth) > 0.99


def test_the_larger_of_two_people(person):
    child = syn.draw(syn.mesh(syn.posed(syn.arms_down(), distance=2.8, aside=-0.95, scale=0.65)))
    found = segment(np.minimum(np.minimum(person, child), syn.room()))
    assert recall(found, person < child) > 0.95
    assert precision(found, person < child) > 0.99
    assert not ((found.labels == PERSON) & np.isfinite(child) & (child < person)).any()


def test_stays_with_the_person_it_began_with(person):
    """A larger one who comes in later is not taken instead."""
    child = syn.draw(syn.mesh(syn.posed(syn.arms_down(), distance=2.8, aside=-0.95, scale=0.75)))
    segmenter = PlaneSegmenter(SegmentConfig())
    first = segmenter.segment(syn.to_frame(np.minimum(child, syn.room())))
    assert recall(first, np.isfinite(child)) > 0.9
    both = syn.to_frame(np.minimum(np.minimum(person, child), syn.room()))
    truth = child < person
    assert recall(segmenter.segment(both), truth) > 0.9
    assert precision(segmenter.segment(both), truth) > 0.98
    segmenter.reset()
    assert precision(segmenter.segment(both), truth) == 0.0


@pytest.mark.parametrize("nothing", [0.0, np.nan, np.inf, 30.0, 0.1, -1.0])
def test_nothing_in_view(nothing):
    depth = np.full((144, 176), nothing)
    found = PlaneSegmenter(SegmentConfig()).segment(
        syn.DepthFrame(0, "optical", depth.astype(np.float32), syn.CAMERA)
    )
    assert not (found.labels == PERSON).any()
    assert not found.depth.any()


def test_an_empty_room():
    found = segment(np.minimum(syn.room(), syn.draw(syn.box([0.5, 0.6, 3.0], [0.8, 0.9, 3.3]))))
    assert not (found.labels == PERSON).any()


def test_hand_before_the_trunk_belongs_to_the_person():
    """Pointing at the camera: hand and arm are a surface of their own, far before the chest."""
    pointing = syn.upright(left_shoulder=syn.rotation("y", -93.0) @ syn.rotation("z", 40.0))
    person = syn.draw(syn.mesh(syn.posed(pointing, distance=2.6)))
    truth = np.isfinite(person)
    hand = truth & (person < 2.1)
    surfaces, _ = kernels.label_components(np.where(truth, person, 0.0), truth, 0.08)
    sizes = np.bincount(surfaces.ravel())
    assert 30 < sizes[surfaces[hand]].max() < 300, "the scene is to have a hand apart from the trunk"
    found = segment(np.minimum(person, syn.room()))
    assert recall(found, truth) > 0.95
    assert recall(found, hand) > 0.8


def test_halves_split_by_an_arm_are_one_person(person):
    """A bar across the waist, nearer by more than a jump, leaves two halves of similar size."""
    rows = slice(66, 72)
    depth = np.minimum(person, syn.room(floor=50.0))
    depth[rows, 60:116] = np.where(np.isfinite(person[rows, 60:116]), 2.65, depth[rows, 60:116])
    found = segment(depth)
    upper, lower = np.isfinite(person), np.isfinite(person)
    upper[66:], lower[:72] = False, False
    assert recall(found, upper) > 0.95
    assert recall(found, lower) > 0.95
    assert precision(found, np.isfinite(person)) > 0.99


def test_a_half_that_splits_off_where_the_person_was_is_theirs(person):
    """Half of a person *beside* another half might be somebody else, unless they stood there before."""
    split = np.minimum(person, syn.room())
    split[:, 86:89] = np.where(np.isfinite(person[:, 86:89]), 2.65, split[:, 86:89])
    sides = np.isfinite(person), np.isfinite(person)
    sides[0][:, 86:], sides[1][:, :89] = False, False
    segmenter = PlaneSegmenter(SegmentConfig())
    alone = segmenter.segment(syn.to_frame(split))
    assert sorted(recall(alone, side) > 0.5 for side in sides) == [False, True]
    segmenter.reset()
    segmenter.segment(syn.to_frame(np.minimum(person, syn.room())))
    for _ in range(2):
        found = segmenter.segment(syn.to_frame(split))
        assert min(recall(found, side) for side in sides) > 0.9
        assert precision(found, np.isfinite(person)) > 0.99


def test_what_hides_the_person_is_unknown(person):
    """Things nearer than the person and pixels without return are not free space."""
    post = syn.draw(syn.box([0.35, -0.5, 1.5], [0.42, 0.9, 1.57]))
    depth = np.minimum(np.minimum(person, post), syn.room())
    depth[10:20, 10:40] = 0.0
    found = segment(depth)
    assert (found.labels[10:20, 10:40] == HIDDEN).all()
    only_post = np.isfinite(post) & ~np.isfinite(person)
    assert (found.labels[only_post] == HIDDEN).mean() > 0.9
    assert found.labels[5, 100] == BACKGROUND
    assert set(np.unique(found.labels)) == {BACKGROUND, PERSON, HIDDEN}


def test_background_that_was_cut_away_is_free_space(person):
    found = segment(person)
    assert set(np.unique(found.labels)) == {BACKGROUND, PERSON}


def test_distance_limits(person):
    depth = np.minimum(person, syn.room())
    assert not (segment(depth, far=2.0).labels == PERSON).any()
    assert not (segment(depth, near=3.8, far=4.0).labels == PERSON).any()


def test_holes_and_bad_values_do_no_harm(person):
    rng = np.random.default_rng(3)
    depth = np.minimum(person, syn.room()).astype(np.float32)
    where = rng.random(depth.shape) < 0.1
    depth[where] = rng.choice(np.array([np.nan, np.inf, -np.inf, -2.0, 0.0, 1e30], np.float32), where.sum())
    found = segment(depth)
    truth = np.isfinite(person) & ~where
    assert recall(found, truth) > 0.9
    assert precision(found, truth) > 0.98
    assert np.isfinite(found.depth).all()


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (1, 40), (16, 16), (48, 5)])
@pytest.mark.parametrize("value", [0.0, 2.0])
def test_tiny_images(shape, value):
    camera = Camera(shape[1], shape[0], 20.0, 20.0, shape[1] / 2, shape[0] / 2)
    found = segment(np.full(shape, value), camera=camera)
    assert found.labels.shape == shape
    assert found.labels.dtype == np.uint8


def test_large_images_are_reduced_to_the_working_grid(person):
    """Blocks of 3 x 3 pixels: the same person, on the grid of a third of the size."""
    camera = Camera(660, 540, 712.5, 712.5, 329.5, 269.5)
    vertices_faces = syn.mesh(syn.posed(syn.arms_down()))
    large = syn.draw(vertices_faces, camera=camera)
    found = segment(np.minimum(large, syn.room(camera=camera)), camera=camera)
    assert found.labels.shape == (180, 220)
    assert found.camera == reduce_camera(camera, 3)
    truth = syn.draw(vertices_faces, camera=found.camera)
    assert recall(found, np.isfinite(truth)) > 0.93
    both = (found.labels == PERSON) & np.isfinite(truth)
    assert np.median(np.abs(found.depth[both] - truth[both])) < 0.003


def test_reduced_camera_sees_the_same_rays():
    """A block's centre keeps its viewing ray."""
    camera = Camera(640, 480, 575.0, 570.0, 319.5, 239.5)
    small = reduce_camera(camera, 4)
    block = np.array([7, 5])
    centre = 4 * block + 1.5
    before = (centre - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    after = (block - [small.cx, small.cy]) / [small.fx, small.fy]
    np.testing.assert_allclose(after, before, rtol=1e-12)


# --- plain twins of the kernels


def test_back_project_twin():
    depth = np.random.default_rng(0).uniform(-1, 4, (9, 7)).astype(np.float32)
    points = Camera(depth.shape[1], depth.shape[0], 50.0, 60.0, 3.2, 4.1).back_project(depth)
    v, u = np.mgrid[:9, :7]
    expected = np.stack([(u - 3.2) / 50.0 * depth, (v - 4.1) / 60.0 * depth, depth], -1)
    expected[depth <= 0] = np.nan
    np.testing.assert_allclose(points, expected, rtol=1e-5)


def test_label_components_twin():
    """Two pixels have one label exactly if a path of small steps joins them."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rng = np.random.default_rng(2)
    depth = rng.choice([1.0, 1.05, 1.5], (20, 24)).astype(np.float32)
    mask = rng.random((20, 24)) < 0.8
    index = np.arange(mask.size).reshape(mask.shape)
    a, b = [], []
    for first, second in (
        ((slice(1, None),), (slice(-1),)),
        ((slice(None), slice(1, None)), (slice(None), slice(-1))),
    ):
        near = (np.abs(depth[first] - depth[second]) <= 0.08) & mask[first] & mask[second]
        a.append(index[first][near])
        b.append(index[second][near])
    a, b = np.concatenate(a), np.concatenate(b)
    _, expected = connected_components(
        coo_matrix((np.ones(len(a)), (a, b)), (mask.size, mask.size)), directed=False
    )
    labels, count = kernels.label_components(depth, mask, 0.08)
    assert (labels[~mask] == 0).all()
    assert set(np.unique(labels[mask])) == set(range(1, count + 1))
    pairs = set(zip(labels[mask].tolist(), expected.reshape(mask.shape)[mask].tolist(), strict=True))
    assert len(pairs) == count == len({p[1] for p in pairs})


def test_component_boxes_twin():
    rng = np.random.default_rng(4)
    points = rng.uniform(1, 3, (10, 12, 3)).astype(np.float32)
    labels = rng.integers(0, 4, (10, 12)).astype(np.int32)
    stats = kernels.component_boxes(points, labels, 3, 100.0)
    for k in range(3):
        mine = points[labels == k + 1].astype(float)
        np.testing.assert_allclose(stats[k, 0], ((mine[:, 2] / 100.0) ** 2).sum(), rtol=1e-6)
        np.testing.assert_allclose(stats[k, 1:4], mine.min(axis=0))
        np.testing.assert_allclose(stats[k, 4:7], mine.max(axis=0))
        assert stats[k, 7] == len(mine)


def test_touching_components_twin():
    rng = np.random.default_rng(6)
    labels = rng.integers(0, 7, (12, 14)).astype(np.int32)
    labels[:, 6:9] = 0
    depth = rng.uniform(1, 2, labels.shape).astype(np.float32)
    chosen = np.array([False, True, False, False, True, False, False])
    small = np.array([True, False, False, False, False, False, True])
    touching = kernels.touching_components(depth, labels, chosen, small, 2, 0.3)
    expected = set()
    for i, j in np.argwhere(labels > 0):
        window = (slice(max(0, i - 2), i + 3), slice(max(0, j - 2), j + 3))
        near = chosen[labels[window]] & (np.abs(depth[window] - depth[i, j]) < 0.3)
        if not chosen[labels[i, j]] and not small[labels[i, j]] and near.any():
            expected.add(int(labels[i, j]))
    assert set(np.flatnonzero(touching).tolist()) == expected


def test_pixels_that_saw_both_are_unknown():
    """Beside the person, and clearly nearer than the wall behind: neither person nor background."""
    depth = np.full((9, 9), 5.0, np.float32)
    labels = np.full((9, 9), BACKGROUND, np.uint8)
    depth[3:6, 3:6], labels[3:6, 3:6] = 2.0, PERSON
    depth[4, 2], depth[4, 6], depth[2, 4] = 3.5, 4.9, 2.1  # mixed, the noisy wall, a thin limb
    depth[0, 0] = 3.0  # far from the person
    depth[6, 3] = 0.0  # nothing seen there
    kernels.mark_mixed(depth, labels, PERSON, HIDDEN, 0.16)
    assert sorted(map(tuple, np.argwhere(labels == HIDDEN))) == [(2, 4), (4, 2)]
    assert (labels == PERSON).sum() == 9
