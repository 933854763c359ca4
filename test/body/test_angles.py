"""Anatomical angles, and how far joints go."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.body.angles import (
    ANGLE_INDEX,
    N_ANGLES,
    angles_from_rotations,
    rotations_from_angles,
    trunk_rotation,
)
from depth_pose.body.limits import HIGH, LOW, clamp_angles, clamp_rotations, violation, with_shoulder_rhythm
from depth_pose.core.skeleton import (
    NODE_INDEX,
)
from postures import nodes_of, posture, some_angles


def test_angles_and_rotations_are_inverse() -> None:
    angles = some_angles(np.random.default_rng(0), 200)
    np.testing.assert_allclose(angles_from_rotations(rotations_from_angles(angles)), angles, atol=1e-9)


@pytest.mark.parametrize(
    ("angles", "start", "end", "direction"),
    [
        ({}, "left_shoulder", "left_wrist", (0, -1, 0)),
        ({"left_shoulder_flexion": 90}, "left_shoulder", "left_elbow", (0, 0, 1)),
        ({"left_shoulder_abduction": 90}, "left_shoulder", "left_elbow", (1, 0, 0)),
        ({"right_shoulder_abduction": 90}, "right_shoulder", "right_elbow", (-1, 0, 0)),
        ({"left_elbow_flexion": 90}, "left_elbow", "left_wrist", (0, 0, 1)),
        ({"left_elbow_flexion": 90, "left_shoulder_twist": 90}, "left_elbow", "left_wrist", (-1, 0, 0)),
        ({"right_elbow_flexion": 90, "right_shoulder_twist": 90}, "right_elbow", "right_wrist", (1, 0, 0)),
        ({"left_hip_flexion": 90}, "left_hip", "left_knee", (0, 0, 1)),
        ({"left_knee_flexion": 90}, "left_knee", "left_ankle", (0, 0, -1)),
        ({"right_hip_abduction": 30}, "right_hip", "right_knee", (-0.5, -np.sqrt(0.75), 0)),
    ],
)
def test_anatomical_angles_mean_what_they_say(angles, start, end, direction) -> None:
    at = nodes_of(posture(**angles))
    bone = at[NODE_INDEX[end]] - at[NODE_INDEX[start]]
    np.testing.assert_allclose(bone / np.linalg.norm(bone), direction, atol=1e-9)


def test_trunk_angles_mean_what_they_say() -> None:
    np.testing.assert_allclose(trunk_rotation(90.0, 0.0, 0.0) @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(trunk_rotation(0.0, 90.0, 0.0) @ [0, 1, 0], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(trunk_rotation(0.0, 0.0, 90.0) @ [0, 0, 1], [1, 0, 0], atol=1e-12)


def test_clamping_brings_everything_inside_and_keeps_what_is_inside() -> None:
    rng = np.random.default_rng(5)
    wild = rng.uniform(-200, 200, (300, N_ANGLES))
    tame = clamp_angles(wild)
    assert violation(wild).max() > 50
    np.testing.assert_allclose(violation(tame), 0.0, atol=1e-9)
    # Arms that point up are free in their plane and twist; everything else is within its range.
    free = [
        ANGLE_INDEX[f"{s}_shoulder_{n}"] for s in ("left", "right") for n in ("flexion", "abduction", "twist")
    ]
    bound = np.setdiff1d(np.arange(N_ANGLES), free)
    assert (tame >= LOW - 1e-9)[:, bound].all() and (tame <= HIGH + 1e-9)[:, bound].all()
    assert np.linalg.norm(tame[:, free[:2]], axis=1).max() < 180 + 1e-9
    np.testing.assert_allclose(clamp_angles(tame), tame, atol=1e-9)


def test_an_elbow_does_not_bend_backward_nor_a_knee_forward() -> None:
    broken = rotations_from_angles(posture(left_elbow_flexion=-40, right_knee_flexion=-30))
    mended = angles_from_rotations(clamp_rotations(broken))
    assert mended[ANGLE_INDEX["left_elbow_flexion"]] == pytest.approx(0, abs=1e-6)
    assert mended[ANGLE_INDEX["right_knee_flexion"]] == pytest.approx(0, abs=1e-6)


def test_the_shoulder_rises_with_the_arm_beyond_thirty_degrees() -> None:
    def elevation(abduction: float) -> float:
        angles = with_shoulder_rhythm(posture(left_shoulder_abduction=abduction))
        return float(angles[ANGLE_INDEX["left_clavicle_elevation"]])

    assert elevation(20) == elevation(30) == 0.0
    assert elevation(150) - elevation(90) == pytest.approx(10.0)
