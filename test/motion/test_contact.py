"""Limbs that reach, limbs out of the body, feet on the floor."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.body.angles import (
    ANGLE_INDEX,
    ARM,
    FOREARM_M,
    LEG,
    N_ANGLES,
    UPPER_ARM_M,
    rotations_from_angles,
    trunk_rotation,
)
from depth_pose.core.skeleton import (
    NODE_INDEX,
    forward_kinematics,
)
from depth_pose.motion._contact_kernels import _closest
from depth_pose.motion.contact import pelvis_height, separate_limbs, support_points, walk_on_floor
from depth_pose.motion.reach import arm_to_target, leg_to_target
from postures import REST, nodes_of, posture


def test_arm_reaches_its_target_with_the_elbow_toward_the_pole() -> None:
    rng = np.random.default_rng(3)
    direction = rng.normal(size=(100, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    target = direction * rng.uniform(0.1, 0.98 * (UPPER_ARM_M + FOREARM_M), (100, 1))
    pole = np.array([0.6, -0.6, -0.3])
    angles = np.zeros((100, N_ANGLES))
    angles[:, ARM[0]] = arm_to_target(target, pole)
    at = nodes_of(angles)
    shoulder, elbow, wrist = (at[:, NODE_INDEX[f"left_{n}"]] for n in ("shoulder", "elbow", "wrist"))
    np.testing.assert_allclose(wrist - shoulder, target, atol=1e-6)
    away = elbow - shoulder - np.sum((elbow - shoulder) * direction, axis=1, keepdims=True) * direction
    assert (away @ pole > -1e-9).all()


def test_leg_reaches_its_target_with_the_foot_flat() -> None:
    rng = np.random.default_rng(4)
    pelvis = trunk_rotation(10.0, 4.0, 12.0)
    ankle = rng.uniform((-0.1, -0.83, -0.15), (0.15, -0.45, 0.15), (100, 3))
    angles = np.zeros((100, N_ANGLES))
    angles[:, :3] = 10.0, 4.0, 12.0
    angles[:, LEG[0]] = leg_to_target(ankle, np.full(100, 8.0), np.zeros(100), pelvis)
    rotations = rotations_from_angles(angles)
    at = forward_kinematics(rotations, np.zeros(3), REST)
    np.testing.assert_allclose(
        at[:, NODE_INDEX["left_ankle"]] - at[:, NODE_INDEX["left_hip"]], ankle, atol=1e-6
    )
    np.testing.assert_allclose(rotations[:, NODE_INDEX["left_foot"], 1, 1], 1.0, atol=1e-9)


def test_standing_feet_rest_on_the_floor() -> None:
    rest = np.tile(np.eye(3), (21, 1, 1))
    assert pelvis_height(rest) == pytest.approx(REST[0, 1])
    assert support_points(rest)[:, 1].min() == pytest.approx(-REST[0, 1])


def test_arms_are_pushed_out_of_the_body() -> None:
    inside = np.stack(
        [
            posture(left_shoulder_abduction=-25, left_elbow_flexion=20),
            posture(right_shoulder_flexion=20, right_shoulder_twist=80, right_elbow_flexion=90),
            posture(left_hip_abduction=-20, right_hip_abduction=-20),
            posture(left_shoulder_abduction=90, right_shoulder_abduction=20),
        ]
    )
    rotations = rotations_from_angles(inside)
    before = separate_limbs(rotations, rounds=1).depth
    after = separate_limbs(rotations)
    assert (before[:3] > 0.01).all() and before[3] == 0.0
    assert (after.depth < 0.003).all()
    assert separate_limbs(after.rotations, rounds=1).depth.max() < 0.004
    np.testing.assert_allclose(after.rotations[3], rotations[3])
    np.testing.assert_allclose(np.linalg.det(after.rotations), 1.0)


def test_closest_points_against_a_fine_grid() -> None:
    rng = np.random.default_rng(7)
    grid = np.linspace(0, 1, 401)
    for _ in range(30):
        a, b, c, d = rng.normal(size=(4, 3))
        s, t = _closest(a, b, c, d)
        found = np.linalg.norm(a + s * (b - a) - c - t * (d - c))
        p, q = a + grid[:, None] * (b - a), c + grid[:, None] * (d - c)
        best = np.linalg.norm(p[:, None] - q[None], axis=-1).min()
        assert found <= best + 1e-9 and best - found < 0.02


def test_the_foot_on_the_floor_stays_where_it_is() -> None:
    t = np.linspace(0, 1, 31)
    angles = np.zeros((31, N_ANGLES))
    # The right leg is lifted; the body sways over the left one.
    angles[:, ANGLE_INDEX["right_hip_flexion"]], angles[:, ANGLE_INDEX["right_knee_flexion"]] = 40, 60
    angles[:, ANGLE_INDEX["left_hip_flexion"]] = 20 * t
    angles[:, ANGLE_INDEX["left_ankle_dorsiflexion"]] = -20 * t
    rotations = rotations_from_angles(angles)
    roots = walk_on_floor(rotations, np.zeros(31))
    heel = (support_points(rotations) + roots[:, None])[:, 0]
    assert np.ptp(heel[:, [0, 2]], axis=0).max() < 0.01
    assert np.ptp(roots[:, 2]) > 0.1
