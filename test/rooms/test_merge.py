"""One skeleton from several, by covariances."""

from __future__ import annotations

import numpy as np
import pytest
from walkers import standing

from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix, rotation_z
from depth_pose.core.skeleton import JointState, Source
from depth_pose.rooms.merge import PlacedSkeleton, confidence_of, merge_skeletons, place, spread_of
from skeletons import make_skeleton

EYES = np.array([[-3.0, 0.0, 1.5], [0.0, -3.0, 1.5], [3.0, 0.0, 1.5]])
TRUTH = standing(0.0, 0.0)


def merge(*seen):
    return merge_skeletons(seen, "person_1", 5, "room")


def seen(camera, positions, age_s=0.0, offset=(0.0, 0.0, 0.0), **values):
    return PlacedSkeleton(make_skeleton(positions, **values), EYES[camera], np.array(offset), age_s)


def sure(confidence):
    return np.full(19, confidence, np.float32)


def test_spreads_are_those_of_a_gaussian():
    rng = np.random.default_rng(0)
    for confidence in (0.2, 0.5, 0.9):
        errors = rng.normal(0.0, spread_of(np.array(confidence)), (200_000, 3))
        assert (np.linalg.norm(errors, axis=1) < 0.1).mean() == pytest.approx(confidence, abs=0.005)
        assert confidence_of(spread_of(np.array(confidence))) == pytest.approx(confidence, abs=1e-3)


def test_one_camera_gives_its_own_skeleton():
    one = make_skeleton(TRUTH, joint_confidence=sure(0.7), build=np.full(13, 0.1, np.float32), scale=1.1)
    merged = merge(PlacedSkeleton(one, EYES[0], np.array([0.1, 0.0, 0.0])))
    assert np.allclose(merged.positions, TRUTH + [0.1, 0.0, 0.0])
    assert np.array_equal(merged.joint_confidence, one.joint_confidence)
    assert np.array_equal(merged.build, one.build)
    assert (merged.frame_id, merged.body_id, merged.stamp_ns, merged.scale) == ("room", "person_1", 5, 1.1)


def test_errors_average_and_confidence_grows():
    """Of cameras at a right angle whose errors lie along their rays."""
    rng = np.random.default_rng(1)
    ones, twos, confidence = [], [], []
    for _ in range(100):
        shown = [
            seen(c, TRUTH + rng.normal(0.0, 0.05, (19, 1)) * axis, joint_confidence=sure(0.75))
            for c, axis in enumerate(([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        ]
        merged = merge(*shown)
        ones.append(np.linalg.norm(shown[0].skeleton.positions - TRUTH, axis=1).mean())
        twos.append(np.linalg.norm(merged.positions - TRUTH, axis=1).mean())
        confidence.append(merged.joint_confidence.mean())
    assert np.mean(twos) < 0.75 * np.mean(ones)
    assert 0.8 < np.mean(confidence) < 0.95


def test_a_camera_far_off_has_no_say():
    off = TRUTH + [0.0, 0.0, 0.4]
    three = merge(seen(0, TRUTH), seen(1, off), seen(2, TRUTH + [0.02, 0.0, 0.0]))
    assert np.abs(three.positions - TRUTH).max() < 0.025
    two = merge(seen(0, off, joint_confidence=sure(0.4)), seen(1, TRUTH, joint_confidence=sure(0.9)))
    assert np.abs(two.positions - TRUTH).max() < 0.1  # the surer one
    assert two.joint_confidence.max() < 0.9  # but less sure


def test_confidence_stays_plausible():
    merged = merge(*(seen(c, TRUTH, joint_confidence=sure(0.6)) for c in range(3)))
    assert (merged.joint_confidence <= 1.0 - 0.3 * 0.4 + 1e-6).all()
    sure_one = merge(seen(0, TRUTH, joint_confidence=sure(0.95)), seen(1, TRUTH, joint_confidence=sure(0.1)))
    assert (sure_one.joint_confidence > 0.93).all()


def test_states_and_hidden_joints():
    """The left arm is hidden from one camera, 15 cm off there; the feet are outside both images."""
    states = np.zeros((2, 19), np.uint8)
    states[0, 5:8], states[:, [14, 18]] = JointState.OCCLUDED, JointState.OUTSIDE_IMAGE
    guessed = TRUTH.copy()
    guessed[5:8] += [0.15, 0.0, 0.0]
    confidence = np.where(states[0] == JointState.OCCLUDED, 0.4, 0.95).astype(np.float32)
    merged = merge(
        seen(0, guessed, joint_states=states[0], joint_confidence=confidence),
        seen(1, TRUTH, joint_states=states[1], joint_confidence=sure(0.95)),
    )
    assert np.abs(merged.positions - TRUTH).max() < 0.02
    assert (merged.joint_states[5:8] == JointState.SEEN).all()
    assert (merged.joint_states[[14, 18]] == JointState.OUTSIDE_IMAGE).all()


def test_old_sightings_count_less_and_are_moved():
    old = seen(0, TRUTH - [0.1, 0.0, 0.0], age_s=0.1, offset=(0.06, 0.0, 0.0))
    merged = merge(old, seen(1, TRUTH))
    error = np.abs(merged.positions - TRUTH).max()
    assert error < 0.02


def test_rotations_are_averaged_whatever_their_signs():
    quats = matrix_to_quat(rotation_z(np.radians([10.0, 20.0])))
    merged = merge(
        seen(0, TRUTH, quats_xyzw=np.tile(quats[0], (19, 1)), source=Source.RECOVERED),
        seen(1, TRUTH, quats_xyzw=np.tile(-quats[1], (19, 1))),
    )
    R = quat_to_matrix(merged.quats_xyzw)
    assert np.degrees(np.arctan2(R[:, 1, 0], R[:, 0, 0])) == pytest.approx(np.full(19, 15.0), abs=1.0)
    assert merged.source == Source.REFINED


def test_placing_a_skeleton_turns_joints_and_rotations():
    """An optical frame that looks along the room's y: x is right, z forward, y down."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = [[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]], [1.0, 2.0, 1.5]
    skeleton = make_skeleton(np.tile([0.5, 0.5, 3.0], (19, 1)))
    placed = place(skeleton, T, "room")
    assert placed.frame_id == "room"
    assert np.allclose(placed.positions, [1.5, 5.0, 1.0])
    assert np.allclose(quat_to_matrix(placed.quats_xyzw), T[:3, :3])
