"""Scores of poses whose distance is known."""

import numpy as np
import pytest

from depth_pose.body.angles import ANGLE_INDEX, N_ANGLES, rotations_from_angles
from depth_pose.volume.headings import headings_of, turns, without_headings
from depth_pose.volume.scoring import (
    SCORED,
    angle_differences,
    best_training_estimate,
    joint_rotations,
    mean_pose_estimate,
    score,
)


def poses(count, seed, spread=15.0):
    angles = np.random.default_rng(seed).normal(0, spread, (count, N_ANGLES))
    return rotations_from_angles(angles)


def test_one_wrong_joint_counts_for_itself():
    truth = np.zeros((4, N_ANGLES))
    wrong = truth.copy()
    wrong[:, ANGLE_INDEX["chest_flexion"]] = 26.0
    got = score(rotations_from_angles(wrong), rotations_from_angles(truth))
    assert got.per_joint_deg[SCORED.index("chest")] == pytest.approx(26.0)
    # the shoulders are scored against the chest, so nothing else is wrong
    assert got.angle_deg == pytest.approx(26.0 / len(SCORED))
    assert got.rms_deg == pytest.approx(26.0 / len(SCORED) / 3)  # one of three degrees of freedom
    assert got.joint_cm > 0


def test_a_wrong_heading_counts_for_the_pelvis_only():
    truth = poses(5, 0)
    got = score(turns(np.radians(10.0)) @ truth, truth)
    assert got.per_joint_deg[SCORED.index("pelvis")] == pytest.approx(10.0)
    assert got.angle_deg == pytest.approx(10.0 / len(SCORED))


def test_angles_of_rotations():
    a, b = joint_rotations(poses(6, 1)), joint_rotations(poses(6, 2))
    cosine = (np.trace(np.swapaxes(a, -1, -2) @ b, axis1=-2, axis2=-1) - 1) / 2
    assert np.allclose(angle_differences(a, b), np.degrees(np.arccos(cosine)), atol=1e-5)


def test_references():
    training, truth = without_headings(poses(30, 3)), poses(8, 4)
    headings = turns(headings_of(truth))
    best = score(best_training_estimate(training, truth, headings), truth)
    mean = score(mean_pose_estimate(training, headings), truth)
    every = [score(headings[:, None] @ np.tile(t, (8, 1, 1, 1)), truth).frames_deg for t in training]
    assert np.allclose(best.frames_deg, np.min(every, axis=0))
    own = best_training_estimate(np.concatenate([training, without_headings(truth)]), truth, headings)
    assert score(own, truth).angle_deg < 1e-4
    assert mean.angle_deg < np.mean(every)


def test_headings():
    rotations = turns(np.array([0.3, -2.0]))[:, None] @ without_headings(poses(2, 5))
    assert np.allclose(headings_of(rotations), [0.3, -2.0])
