"""Postures that tests of angles and of motion share."""

from __future__ import annotations

import numpy as np

from depth_pose.body.angles import ANGLE_INDEX, N_ANGLES, rotations_from_angles
from depth_pose.core.skeleton import ADULT_STATURE_M, forward_kinematics, rest_nodes

REST = rest_nodes() * ADULT_STATURE_M


def some_angles(rng: np.random.Generator, count: int) -> np.ndarray:
    angles = rng.uniform(-35, 35, (count, N_ANGLES))
    for name in ("elbow_flexion", "knee_flexion"):
        for side in ("left", "right"):
            angles[:, ANGLE_INDEX[f"{side}_{name}"]] = rng.uniform(0, 120, count)
    return angles


def nodes_of(angles: np.ndarray) -> np.ndarray:
    return forward_kinematics(rotations_from_angles(angles), np.zeros(3), REST)


def posture(**degrees: float) -> np.ndarray:
    angles = np.zeros(N_ANGLES)
    for name, value in degrees.items():
        angles[ANGLE_INDEX[name]] = value
    return angles
