"""The joint net with the weights that ship, and the crops that it and its training see."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import BACKGROUND, HIDDEN
from depth_pose.core.measurement import CropMask, CropView, JointMeasurement
from depth_pose.core.skeleton import (
    JOINT_INDEX,
    JOINT_NODES,
    LANDMARKS,
    MIRROR_JOINTS,
    MIRROR_LANDMARKS,
    NODE_INDEX,
)
from depth_pose.detect import _crop_kernels as kernels
from depth_pose.detect.candidates import CandidateFinder
from depth_pose.detect.crop import Crop
from depth_pose.detect.crop_mask import add_and_remove, refuse
from depth_pose.detect.joint_calibration import DeviationScale, PersonOdds
from depth_pose.detect.joint_codec import JointCodec, JointCodes
from depth_pose.detect.joint_net import QUICK, THOROUGH, VotingNet
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.net import read_weights
from depth_pose.sim.scenes import sample_scene

SIDE, CELL_M = 100, 0.03
TRUNK = [JOINT_INDEX[n] for n in ("pelvis", "spine", "chest", "neck", "head")]


def scene(*bodies):
    depth = syn.room()
    for body in bodies:
        depth = np.minimum(depth, syn.draw(syn.mesh(body)))
    return syn.to_frame(depth, noise=0.004)


def sample(depth, labels, look):
    grid = np.empty((SIDE, SIDE), np.float32)
    whose = np.empty(grid.shape, np.int64)
    kernels.sample_crop(depth, labels, syn.CAMERA, look, grid, whose)
    return grid, whose


@pytest.mark.parametrize("name", [THOROUGH, QUICK])
def test_weights_are_those_that_the_settings_were_made_for(name):
    model = read_weights(f"{name}.onnx")
    settings = json.loads((resources.files("depth_pose.detect") / "weights" / f"{name}.json").read_text())
    assert hashlib.sha256(model).hexdigest() == settings["weights_sha256"]
    assert len(model) < 3_000_000


@pytest.mark.parametrize(("distance", "turn"), [(2.2, 0.0), (3.0, 30.0), (3.6, 0.0)])
def test_joints_of_somebody_who_stands_free(distance, turn):
    body = syn.posed(syn.arms_down(), distance=distance, turn=turn)
    seen, *others = sorted(
        LearnedSegmenter(SegmentConfig()).segment(scene(body)).detections, key=lambda s: -s.probability
    )
    assert all(other.probability < SegmentConfig().start for other in others)
    measured = seen.measured
    error = np.linalg.norm(measured.places - body.nodes[JOINT_NODES], axis=1)
    assert np.median(error[TRUNK]) < 0.08
    assert np.median(error) < 0.12
    assert ((measured.confidence > 0) & (measured.confidence <= 1)).all()
    assert measured.sigma.shape == (19, 2)
    assert (measured.sigma > 0).all()
    ankles = body.nodes[[NODE_INDEX["left_ankle"], NODE_INDEX["right_ankle"]]]
    assert np.linalg.norm(measured.heels[:, :3] - ankles, axis=1).max() < 0.2
    assert (measured.heels[:, 3:] > 0).all()


def test_same_frame_same_bits():
    frame = scene(syn.posed(syn.arms_down()))
    first, again = (LearnedSegmenter(SegmentConfig()).segment(frame).detections[0] for _ in range(2))
    np.testing.assert_array_equal(first.measured.places, again.measured.places)
    np.testing.assert_array_equal(first.measured.confidence, again.measured.confidence)


@pytest.mark.parametrize("turn", [0.0, 80.0, 160.0])
def test_with_the_mirror_image_left_and_right_are_seen_alike(turn):
    depth = scene(syn.posed(syn.arms_down(), distance=2.6, aside=0.3, turn=turn)).depth
    both = depth, np.ascontiguousarray(depth[:, ::-1])  # the camera's axis is in the middle
    torso = np.array([0.3, 0.2, 2.6])
    gaps = []
    for mirror in (True, False):
        net, points = VotingNet(mirror=mirror), []
        for image, sign in zip(both, (1.0, -1.0), strict=True):
            labels = (np.abs(image - 2.6) < 0.5).astype(np.uint8)
            seen = net.look(Crop(image, labels, syn.CAMERA, 1, torso * [sign, 1.0, 1.0], 0.9))
            points.append(seen.places * [sign, 1.0, 1.0])
        swapped = points[1][MIRROR_JOINTS]  # the mirror image's left is the right
        gaps.append(np.linalg.norm(points[0] - swapped, axis=1).mean())
    assert gaps[0] < 0.8 * gaps[1]


def test_mirrored_twice_is_the_same():
    rng = np.random.default_rng(5)
    count = len(MIRROR_LANDMARKS)
    places, width = (rng.normal(size=(count, n)).astype(np.float32) for n in (3, 2))
    answer = JointCodes(places, width, 1.5, 2.0, np.eye(4, dtype=np.float32))
    again = answer.mirrored().mirrored()
    np.testing.assert_array_equal(again.places, answer.places)
    np.testing.assert_array_equal(again.mask, answer.mask)
    other = answer._replace(places=places[MIRROR_LANDMARKS], behind=-1.5)
    assert answer.mean(other).behind == answer.behind  # the other names left and right the other way
    np.testing.assert_array_equal(answer.mean(other).places, answer.places)


def test_deviations_are_scaled_and_confidences_are_not(tmp_path):
    settings = json.loads(read_weights("joint_finder.json"))
    seen = []
    for number, bias in enumerate((0.0, np.log(2.0))):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "joint_finder.onnx").write_bytes(read_weights("joint_finder.onnx"))
        weights = np.zeros_like(settings["deviations"]["weights"])
        weights[0, 0] = bias  # in the plane alone
        scaled = settings["deviations"] | {"weights": weights.tolist()}
        (folder / "joint_finder.json").write_text(json.dumps(settings | {"deviations": scaled}))
        depth = scene(syn.posed(syn.arms_down(), distance=2.6)).depth
        labels = (np.abs(depth - 2.6) < 0.5).astype(np.uint8)
        crop = Crop(depth, labels, syn.CAMERA, 1, np.array([0.0, 0.2, 2.6]), 0.9)
        seen.append(VotingNet(folder).look(crop))
    np.testing.assert_allclose(seen[1].sigma, seen[0].sigma * [2.0, 1.0], rtol=1e-6)
    np.testing.assert_allclose(seen[1].heels[:, 3:], seen[0].heels[:, 3:] * [2.0, 1.0], rtol=1e-6)
    np.testing.assert_array_equal(seen[1].confidence, seen[0].confidence)


def test_factors_on_deviations_do_not_grow_beyond_what_they_were_fitted_for():
    scale = DeviationScale(
        **{k: np.array(v) for k, v in json.loads(read_weights("joint_finder.json"))["deviations"].items()}
    )
    corners = np.stack(np.meshgrid(*zip(scale.least, scale.most, strict=True)), axis=-1).reshape(-1, 3)
    inside = np.random.default_rng(3).uniform(scale.least, scale.most, (200, 3))
    factors = scale.factors(np.concatenate([corners, inside]))
    assert (factors > 0.3).all()
    assert (factors < 3.0).all()
    outside = scale.least - 5.0
    np.testing.assert_array_equal(scale.factors(outside), scale.factors(scale.least))
    middle = 0.5 * (scale.least + scale.most)
    np.testing.assert_allclose(scale.factors(middle), np.exp(scale.weights[:, 0]))


def test_bends_tell_noise_of_pixels_from_that_of_blocks():
    rng, whose = np.random.default_rng(4), np.ones((64, 64), np.int64)
    plane = (2.0 + 0.01 * np.arange(64)[:, None] + 0.02 * np.arange(64)).astype(np.float32)
    assert kernels.measure_bend(plane, whose, 1, 1) <= 2 * kernels.STRAIGHTEST
    fine = plane + rng.normal(0, 0.01, plane.shape).astype(np.float32)
    coarse = plane + np.kron(rng.normal(0, 0.01, (16, 16)), np.ones((4, 4))).astype(np.float32)
    expected = 0.01 * np.sqrt(6.0) * 0.6745  # the median of |a - 2 b + c|
    for step in (1, 4):
        assert kernels.measure_bend(fine, whose, 1, step) == pytest.approx(expected, rel=0.1)
    assert kernels.measure_bend(coarse, whose, 1, 4) == pytest.approx(expected, rel=0.15)
    assert kernels.measure_bend(coarse, whose, 1, 1) < 0.6 * expected
    assert kernels.measure_bend(fine, whose, 2, 1) == kernels.STRAIGHTEST


@pytest.mark.parametrize("distance", [2.6, 3.0])
def test_it_looks_again_without_the_wall_that_was_taken_for_a_part_of_the_person(distance):
    body = syn.posed(syn.arms_down(), distance=distance)
    depth = scene(body).depth
    labels = (np.abs(depth - scene().depth) > 0.05).astype(np.uint8)
    v, u = np.nonzero(labels)
    beside = labels.copy()
    beside[v.min() : v.max(), u.max() : u.max() + 25] = 1
    net = VotingNet()
    clean, spoiled = (
        net.look(Crop(depth, some, syn.CAMERA, 1, np.array([0.0, 0.2, distance]), 0.9))
        for some in (labels, beside)
    )
    apart = np.linalg.norm(clean.places - spoiled.places, axis=1)
    assert apart.mean() < 0.008  # without the second look .010 and .011


@pytest.mark.parametrize("name", [THOROUGH, QUICK])
@pytest.mark.parametrize("torso", [(0.0, 0.0, 0.3), (4.0, -3.0, 1.0), (0.0, 0.0, 9.0)])
def test_where_nobody_is_it_answers_in_numbers(torso, name):
    blank = np.zeros((syn.CAMERA.height, syn.CAMERA.width), np.float32)
    net = VotingNet(name=name)
    seen = net.look(Crop(blank, blank.astype(np.uint8), syn.CAMERA, 1, np.array(torso), 0.5))
    assert np.isfinite(seen.places).all()
    assert (seen.confidence > 0).all()
    assert 0 < seen.probability < 1


def test_at_high_speed_the_quick_net_follows_the_thorough_one():
    segmenter, asked = LearnedSegmenter(SegmentConfig(speed="high")), []
    body = syn.posed(syn.arms_down(), distance=2.6)

    class Told:
        def __init__(self, name, net):
            self.name, self.net = name, net

        def look(self, crop):
            asked.append(self.name)
            return self.net.look(crop)

    segmenter.joint_net = Told(THOROUGH, segmenter.joint_net)
    segmenter.quick_net = Told(QUICK, segmenter.quick_net)
    frame = scene(body)
    for k in range(6):
        seen = segmenter.segment(replace(frame, stamp_ns=k * 33_000_000)).detections
    assert len(seen) == 1
    assert asked == [THOROUGH] + [QUICK] * (len(asked) - 1)
    assert len(asked) > 1
    error = np.linalg.norm(seen[0].measured.places - body.nodes[JOINT_NODES], axis=1)
    assert np.median(error) < 0.12


def test_both_looks_count_for_whether_it_is_a_person():
    odds = PersonOdds(*json.loads(read_weights("joint_finder.json"))["person"])
    by_first = [odds.probability(p, 0.0) for p in (0.0, 0.2, 0.6, 1.0)]
    by_second = [odds.probability(0.5, logit) for logit in (-8.0, 0.0, 8.0)]
    assert by_first == sorted(by_first)
    assert by_second == sorted(by_second)
    assert by_second[0] < 0.3 < 0.7 < by_second[-1]


def test_second_look_tells_coats_and_heaps_from_people():
    candidates, segmenter = CandidateFinder(SegmentConfig()), LearnedSegmenter(SegmentConfig())
    first = second = 0
    for k in range(160):
        rng = np.random.default_rng([31, k])
        scene = sample_scene(rng, people=0, studio=False, lookalikes=True, mounting="common")
        frame = DepthFrame(0, "", scene.depth, scene.camera)
        segmenter.reset()
        candidates.reset()
        seen = segmenter.segment(frame)
        first += sum(p.probability >= 0.6 for p in candidates.find(frame).people)
        second += sum(p.probability >= 0.6 for p in seen.detections)
        labels = {p.label for p in seen.detections}
        assert set(np.unique(seen.labels)) - {BACKGROUND, HIDDEN} <= labels  # things are background
    assert first > 10
    assert second <= 0.7 * first  # pets and crumpled blankets are new to it


@pytest.mark.parametrize("behind", [-9.0, 9.0])
def test_what_is_encoded_is_decoded(behind):
    view = CropView(0.4, -0.2, 2.5, CELL_M)
    landmarks = np.random.default_rng(0).uniform(-0.6, 0.6, (len(LANDMARKS), 3)) + [0, 0, 2.5]
    codec = JointCodec(0.01)
    places = codec.encode(landmarks, view)
    if behind > 0:  # named by the side of the image
        places = places[MIRROR_LANDMARKS]
    widths = np.full((len(LANDMARKS), 2), np.log(0.05), np.float32)
    decoded = codec.decode(JointCodes(places, widths, behind, 0.0, np.zeros((4, 4))), view)
    np.testing.assert_allclose(decoded.places, landmarks, atol=1e-12)
    assert decoded.left_right_confidence == pytest.approx(1.0 / (1.0 + np.exp(-9.0)))
    apart = np.linalg.norm(landmarks - landmarks[MIRROR_LANDMARKS], axis=1)
    exchanged = (1.0 - decoded.left_right_confidence) * apart
    np.testing.assert_allclose(decoded.error - decoded.error.min(), exchanged, atol=1e-9)
    mirrored = codec.encode(landmarks, view._replace(flip=-1.0))
    np.testing.assert_allclose(mirrored[MIRROR_LANDMARKS] * [-1.0, 1.0, 1.0], codec.encode(landmarks, view))


class _FixedNet:
    """A joint net of a few lines: everybody stands straight."""

    def look(self, crop):
        down = np.linspace(-0.6, 0.9, 19)
        places = (crop.torso + down[:, None] * [0.0, 1.0, 0.0]).astype(np.float32)
        view = CropView(*crop.torso.tolist(), CELL_M)
        mask = CropMask(np.zeros((SIDE, SIDE), np.float32), view)
        sigma, sure = np.full((19, 2), 0.1, np.float32), np.full(19, 0.5, np.float32)
        return JointMeasurement(places, sigma, sure, probability=crop.probability, mask=mask)


def test_another_net_is_one_class():
    segmenter = LearnedSegmenter(SegmentConfig())
    segmenter.joint_net = _FixedNet()
    detections = segmenter.segment(scene(syn.posed(syn.arms_down()))).detections
    seen = max(detections, key=lambda d: d.probability)
    assert seen.measured.heels.shape == (0, 5)
    np.testing.assert_allclose(seen.measured.places[:, 0], seen.place[0], atol=1e-6)


@pytest.mark.parametrize("flip", [1.0, -1.0])
@pytest.mark.parametrize("angle", [0.0, 25.0])
def test_a_dot_lies_in_the_crop_where_its_coordinates_say(flip, angle):
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    look, point = CropView(0.2, 0.1, 3.0, CELL_M, cos, sin, flip), np.array([[0.45, -0.3, 2.8]])
    u, v = np.rint(syn.CAMERA.project(point[0])).astype(int)
    depth = np.full((syn.CAMERA.height, syn.CAMERA.width), 4.0, np.float32)
    labels = np.zeros(depth.shape, np.uint8)
    depth[v - 3 : v + 4, u - 3 : u + 4], labels[v - 3 : v + 4, u - 3 : u + 4] = 2.8, 5
    _, whose = sample(depth, labels, look)
    place = np.empty((1, 3))
    kernels.to_crop(point, look, place)
    rows, cols = np.nonzero(whose == 5)
    middle = (np.array([cols.mean(), rows.mean()]) - 0.5 * (SIDE - 1)) * CELL_M
    np.testing.assert_allclose(middle, place[0, :2], atol=0.02)


def test_features_of_own_pixels_others_and_what_lies_outside():
    depth = np.full((syn.CAMERA.height, syn.CAMERA.width), 3.5, np.float32)
    labels = np.zeros(depth.shape, np.uint8)
    labels[:, : depth.shape[1] // 2] = 1
    depth[labels == 1] = 2.75
    look = CropView(0.0, 0.0, 3.0, CELL_M)
    grid, whose = sample(depth, labels, look)
    out = np.empty((kernels.CHANNELS, *grid.shape), np.float32)
    kernels.fill_features(grid, whose, 1, look, out)
    own, inside = whose == 1, whose >= 0
    assert inside.any()
    np.testing.assert_allclose(out[0], np.where(own, -0.5, 0.0))
    np.testing.assert_allclose(out[2], np.where(own, -0.5, np.where(inside, 1.0, 0.0)))
    np.testing.assert_array_equal(out[1], own)
    np.testing.assert_array_equal(out[4], inside)
    np.testing.assert_allclose(out[7], 1 / 3, rtol=1e-6)


def test_the_mask_takes_furniture_out_and_puts_limbs_in():
    """The left half of the crop is surely the person, the right one is not, the lowest quarter is unknown."""
    depth = np.full((syn.CAMERA.height, syn.CAMERA.width), 3.0, np.float32)
    depth[:, :20] = 6.0  # too far from the torso to be the person's
    labels = np.zeros(depth.shape, np.uint8)
    labels[:, depth.shape[1] // 2 :] = 1
    labels[:10] = 2  # somebody else
    before = labels.copy()
    logits = np.full((SIDE, SIDE), 9.0, np.float32)
    logits[:, SIDE // 2 :], logits[3 * SIDE // 4 :] = -9.0, 0.0
    middle = 3.0 * np.array([(syn.CAMERA.width / 2 - syn.CAMERA.cx) / syn.CAMERA.fx, 0.0])
    mask = CropMask(logits, CropView(float(middle[0]), 0.0, 3.0, CELL_M))
    add_and_remove(mask, depth, labels, syn.CAMERA, 1)
    changed = labels != before
    assert changed.any()
    assert set(labels[changed & (before == 1)]) == {BACKGROUND}
    assert set(labels[changed & (before == BACKGROUND)]) == {1}
    assert (labels[:10] == 2).all()
    assert not changed[:, :20].any()
    rows = np.flatnonzero(changed.any(axis=1))
    assert rows.max() - syn.CAMERA.cy <= syn.CAMERA.fy * 0.25 * SIDE * CELL_M / 3.0 + 2
    right = np.flatnonzero((changed & (before == 1)).any(axis=0))
    assert right.min() >= depth.shape[1] // 2 - 1


def test_a_mask_refuses_only_doubted_pixels_that_hardly_show_the_person():
    """The crop's right half shows nobody, its lower quarter is unclear, the rest is somebody for certain."""
    camera = syn.CAMERA
    labels = np.ones((camera.height, camera.width), np.uint8)
    labels[:10] = 2  # somebody else
    doubted = np.zeros(labels.shape, np.bool_)
    doubted[::2] = True
    logits = np.full((SIDE, SIDE), 9.0, np.float32)
    logits[:, SIDE // 2 :], logits[3 * SIDE // 4 :] = -9.0, 0.0
    mask = CropMask(logits, CropView(0.1, 0.0, 3.0, CELL_M))
    before = labels.copy()
    refuse(mask, labels, doubted, camera, 1)
    v, u = np.mgrid[: camera.height, : camera.width]
    right = u - camera.cx > camera.fx * 0.1 / 3.0
    low = v - camera.cy > camera.fy * 0.25 * SIDE * CELL_M / 3.0
    border = np.abs(u - camera.cx - camera.fx * 0.1 / 3.0) < 2
    border |= np.abs(v - camera.cy - camera.fy * 0.25 * SIDE * CELL_M / 3.0) < 2
    expected = np.where(doubted & (before == 1) & (right | low), BACKGROUND, before)
    np.testing.assert_array_equal(labels[~border], expected[~border])
    assert (labels[~border] != before[~border]).any()
