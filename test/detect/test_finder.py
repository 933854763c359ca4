"""The people finder with the weights that ship, in scenes whose answers are known."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES
from depth_pose.detect import _finder_kernels as kernels
from depth_pose.detect import _vote_kernels as votes_of
from depth_pose.detect.clusters import Clusters
from depth_pose.detect.finder import PeopleFinder, join_parts, load_weights
from depth_pose.detect.turned import NORMAL_GRID, reduce_frame

CERTAIN = 0.6
KINECT = Camera(640, 480, 575.0, 575.0, 319.5, 239.5)
TORSO = [JOINT_INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("shoulder", "hip")]


@pytest.fixture(scope="module")
def finder():
    return PeopleFinder()


def persons(found):
    return [p for p in found.people if p.probability >= CERTAIN]


def torso_of(posed):
    return posed.nodes[JOINT_NODES][TORSO].mean(axis=0)


def scene(*bodies, camera=syn.CAMERA, **room):
    depth = syn.room(camera=camera, **room)
    for body in bodies:
        depth = np.minimum(depth, syn.draw(syn.mesh(body), camera=camera))
    return syn.to_frame(depth, camera=camera, noise=0.004)


def test_weights_are_those_that_the_settings_were_made_for():
    model, settings = load_weights()
    assert hashlib.sha256(model).hexdigest() == settings["weights_sha256"]
    folder = resources.files("depth_pose.detect") / "weights"
    assert sum(len(path.read_bytes()) for path in folder.iterdir()) < 6_000_000


@pytest.mark.parametrize("camera", [syn.CAMERA, KINECT, Camera(320, 240, 280.0, 280.0, 159.5, 119.5)])
@pytest.mark.parametrize(("distance", "turn"), [(2.2, 0.0), (3.0, 60.0), (3.6, 180.0)])
def test_a_person_in_a_room(finder, camera, distance, turn):
    body = syn.posed(syn.arms_down(), distance=distance, turn=turn)
    frame = scene(body, camera=camera)
    found = finder.find(frame)
    (person,) = persons(found)
    assert np.linalg.norm(person.torso - torso_of(body)) < 0.15
    truth = np.isfinite(syn.draw(syn.mesh(body), camera=found.camera))
    own = found.labels == person.label
    assert (own & truth).sum() / (own | truth).sum() > 0.8


def test_a_person_in_a_view_of_120_degrees(finder):
    """Of 40 degrees they would have three times the rows; the net's image has more for such views."""
    camera = Camera(512, 512, 148.0, 148.0, 255.5, 255.5)
    assert reduce_frame(scene(camera=camera)).depth.shape == (240, 240)
    assert reduce_frame(scene()).depth.shape == NORMAL_GRID
    for distance, aside in ((2.2, -1.5), (3.0, 0.0), (3.0, 1.2)):
        body = syn.posed(syn.arms_down(), distance=distance, aside=aside, turn=30.0)
        frame = scene(body, camera=camera)
        (person,) = persons(finder.find(frame))
        assert np.linalg.norm(person.torso - torso_of(body)) < 0.15
        (turned,) = persons(finder.find(replace(frame, depth=frame.depth[::-1, ::-1].copy()), turns=2))
        assert np.linalg.norm(turned.torso - torso_of(body) * (-1, -1, 1)) < 0.15


def test_two_people_side_by_side_are_two(finder):
    bodies = [syn.posed(syn.arms_down(), aside=x) for x in (-0.4, 0.4)]
    found = persons(finder.find(scene(*bodies)))
    assert len(found) == 2
    for body in bodies:
        assert min(np.linalg.norm(p.torso - torso_of(body)) for p in found) < 0.2


def test_a_person_whose_background_was_cut_away(finder):
    depth = syn.draw(syn.mesh(syn.posed(syn.arms_down())))
    assert len(persons(finder.find(syn.to_frame(depth)))) == 1


@pytest.mark.parametrize("wall", [1.0, 2.5, 4.6])
def test_an_empty_room_yields_nobody(finder, wall):
    assert not finder.find(scene(wall=wall)).people


def test_a_cupboard_and_a_box_are_nobody(finder):
    things = syn.draw(syn.box([-1.2, -0.9, 3.2], [-0.5, 0.9, 3.8]), syn.box([0.3, 0.5, 2.4], [0.8, 0.9, 2.9]))
    assert not persons(finder.find(syn.to_frame(np.minimum(things, syn.room()), noise=0.004)))


@pytest.mark.parametrize("depth", [0.0, np.nan, np.inf, 0.05, 0.3, 40.0])
def test_images_of_one_value_yield_nobody(finder, depth):
    image = np.full((480, 640), depth, np.float32)
    found = finder.find(syn.to_frame(image, camera=KINECT))
    assert not found.people
    assert not found.labels.any()


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (3, 200), (50, 2)])
def test_images_of_a_few_pixels_yield_nobody(finder, size):
    camera = Camera(size[1], size[0], 100.0, 100.0, 0.0, 0.0)
    assert not finder.find(syn.to_frame(np.full(size, 2.0), camera=camera)).people


def test_noise_alone_yields_nobody(finder):
    image = np.random.default_rng(0).uniform(0.5, 6.0, (240, 320))
    assert not persons(finder.find(syn.to_frame(image, camera=Camera(320, 240, 280.0, 280.0, 159.5, 119.5))))


def test_same_frame_same_bits(finder):
    frame = scene(syn.posed(syn.arms_down()))
    first, again = finder.find(frame), PeopleFinder().find(frame)
    finder.find(scene(syn.posed(syn.arms_down(), aside=0.7)))
    for other in (again, finder.find(frame)):
        np.testing.assert_array_equal(first.labels, other.labels)
        for a, b in zip(first.people, other.people, strict=True):
            assert a.probability == b.probability
            np.testing.assert_array_equal(a.torso, b.torso)


def test_features_against_plain_formulas():
    frame = scene(syn.posed(syn.arms_down()))
    image = reduce_frame(frame)
    c, shape = image.camera, (kernels.ROWS, kernels.COLS)
    out = np.empty((kernels.CHANNELS, *shape), np.float32)
    sums = np.zeros((shape[0] + 1, shape[1] + 1))
    behind = image.depth + np.float32(0.5)
    behind[:, ::2] = 0.0  # unknown
    kernels.fill_features(image, behind, sums, sums.astype(np.int64), out)
    rng = np.random.default_rng(1)
    for i, j in zip(rng.integers(0, image.rows, 200), rng.integers(0, image.cols, 200), strict=True):
        z = float(image.depth[i, j])
        assert out[3, i, j] == (z > 0)
        is_known = behind[i, j] > 0
        assert out[10, i, j] == (0.0 if z > 0 or not is_known else pytest.approx(1 / behind[i, j], abs=1e-5))
        if z == 0:
            continue
        assert out[11, i, j] == pytest.approx(2.0 - 0.5 if is_known else 0.0, abs=1e-4)
        expected = [min(1 / z, 2.5)]
        for half in (0.12, 0.5):
            r = max(1, int(half * c.fx / z + 0.5))
            window = image.depth[max(0, i - r) : i + r + 1, max(0, j - r) : j + r + 1]
            expected.append(np.clip((z - window[window > 0].mean()) / half, -3, 3))
        np.testing.assert_allclose(out[:3, i, j], expected, atol=2e-3)
        assert out[4, i, j] == pytest.approx(np.log(z / c.fx) + 4, abs=5e-3)
        assert out[9, i, j] == pytest.approx(np.clip(z * (i - c.cy) / c.fy, -3, 3), abs=1e-4)


def test_votes_of_two_torsos_gather_in_two_places():
    rng = np.random.default_rng(2)
    truth = np.array([[-0.3, 0.0, 3.0], [0.4, 0.1, 3.1]])
    votes = np.concatenate([t + 0.05 * rng.standard_normal((300, 3)) for t in truth])
    density = np.zeros(int(np.prod(votes_of.CELLS)))
    modes = np.empty((8, 3))
    count = votes_of.find_modes(votes, np.full(600, 1e-3), density, 0.3, 0.02, 8, modes)
    assert count == 2
    np.testing.assert_allclose(modes[np.argsort(modes[:2, 0])], truth, atol=0.02)
    assert not density.any()


@pytest.mark.parametrize("at", range(4))
def test_one_sample_without_a_return_is_left_out(at):
    """NaN as 0; `min` and `max` of a kernel drop a NaN in the second place."""
    near, far = np.float32(0.2), np.float32(12.0)
    for missing in (0.0, np.nan):
        samples = np.array([2.0, 2.01, 2.02, 2.03], np.float32)
        samples[at] = missing
        mean = np.delete(samples, at).mean()
        assert kernels.near_second(*samples, near, far) == pytest.approx(mean, abs=1e-6)


def test_nan_and_zero_are_the_same(finder):
    frame = scene(syn.posed(syn.arms_down()))
    holes = np.random.default_rng(3).random(frame.depth.shape) < 0.02
    found = [
        finder.find(replace(frame, depth=np.where(holes, np.float32(hole), frame.depth)))
        for hole in (0.0, np.nan)
    ]
    assert len(persons(found[0])) == 1
    np.testing.assert_array_equal(found[0].labels, found[1].labels)
    np.testing.assert_array_equal(found[0].chance, found[1].chance)


def test_parts_are_joined_through_parts():
    """A hand on a forearm on a person is theirs, in whatever order they were found; people stay apart."""
    areas, neighbour = np.array([0.01, 0.03, 0.4, 0.5]), np.array([1, 2, 3, -1])
    for order in (np.arange(4), np.arange(4)[::-1]):
        measures = np.zeros((4, 20))
        measures[:, 6], measures[:3, 18] = np.log(areas[order] + 1e-4), 1.0
        measures[:, 18] = (order < 3).astype(float)
        where = np.argsort(order)
        neighbours = np.array([where[neighbour[k]] if neighbour[k] >= 0 else -1 for k in order])
        found = Clusters(np.zeros((1, 1), np.uint8), np.zeros((4, 3)), measures, neighbours)
        number = np.zeros(5, np.uint8)
        number[1 + where[2]], number[1 + where[3]] = 1, 2
        join_parts(found, number, order < 2)
        assert number[1 + where].tolist() == [1, 1, 1, 2]
