"""Pose errors: joint angles in degrees, joints in centimetres, with baselines.

The baselines are the error of always returning the mean training pose, and that of the training pose nearest
to the truth, which is the limit of methods that retrieve training poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import nearest_rotation
from depth_pose.core.skeleton import (
    ADULT_STATURE_M,
    JOINT_NODES,
    JOINTS,
    NODE_INDEX,
    NODES,
    forward_kinematics,
    rest_nodes,
)

Array = NDArray[np.float64]

SCORED: tuple[str, ...] = tuple(
    name for name in JOINTS if not name.endswith(("foot", "wrist", "neck", "head"))
)
"""The 13 joints whose rotation is scored, those visible in a volume. Hands, neck and head hardly change it
(and deviate little between performances of the dances, so counting them would improve every figure); the
feet rotate with the ankles."""

_NODES = np.array([NODE_INDEX[name] for name in SCORED])
# shoulders against the chest: the clavicles are not joints of the skeleton
_PARENT_OF = {
    "pelvis": -1, "spine": 0, "chest": 1, "shoulder": 2, "hip": 0,
    "elbow": "shoulder", "knee": "hip", "ankle": "knee",
}  # fmt: skip


def _parents() -> NDArray[np.int64]:
    out = []
    for name in SCORED:
        side, _, bare = name.rpartition("_")
        parent = _PARENT_OF[bare]
        out.append(NODE_INDEX[f"{side}_{parent}"] if isinstance(parent, str) else parent)
    return np.array(out)


_PARENTS = _parents()


def joint_rotations(rotations: Array) -> Array:
    """Rotation of each scored joint against its parent, (..., 21, 3, 3) to (..., 13, 3, 3).

    The pelvis' is against the world, so that a wrong heading counts.
    """
    child = rotations[..., _NODES, :, :]
    parent = rotations[..., np.maximum(_PARENTS, 0), :, :].copy()
    parent[..., _PARENTS < 0, :, :] = np.eye(3)
    return np.asarray(np.swapaxes(parent, -1, -2) @ child)


def angle_differences(a: Array, b: Array) -> Array:
    """Angles in degrees between joint rotations, (..., J, 3, 3) each, shape (..., J)."""
    # |R - S|_F = 2 sqrt(2) sin(angle / 2): good at small angles, where the trace is not
    norm = np.linalg.norm(a - b, axis=(-2, -1))
    return np.asarray(np.degrees(2.0 * np.arcsin(np.clip(norm / (2.0 * np.sqrt(2.0)), 0.0, 1.0))))


def joint_positions(rotations: Array, stature: float = ADULT_STATURE_M) -> Array:
    """Joints (..., 19, 3) of a person of a stature, pelvis at the origin, metres."""
    root = np.zeros((*rotations.shape[:-3], 3))
    return forward_kinematics(rotations, root, rest_nodes() * stature)[..., JOINT_NODES, :]


def mean_rotations(rotations: Array) -> Array:
    """Compute the mean rotation of (N, 21, 3, 3), node by node, (21, 3, 3)."""
    return nearest_rotation(rotations.mean(axis=0))


@dataclass(frozen=True)
class Score:
    """Errors of one performance.

    Attributes
    ----------
    angle_deg : float
        Mean over frames and the 13 scored joints of the angle between estimate and truth.
    rms_deg : float
        As in the paper: root mean square over the frames of each degree of freedom (three per
        joint), averaged.
    joint_cm : float
        Mean distance of the 19 joints, pelvis on pelvis.
    per_joint_deg : (13,) float64
    frames_deg : (T,) float64
    """

    angle_deg: float
    rms_deg: float
    joint_cm: float
    per_joint_deg: Array
    frames_deg: Array


def score(estimate: Array, truth: Array) -> Score:
    """Compare estimated segment rotations with the true ones, both (T, 21, 3, 3), world frame."""
    if estimate.shape != truth.shape or estimate.shape[1:] != (len(NODES), 3, 3):
        raise ValueError(f"rotations of shapes {estimate.shape} and {truth.shape}")
    a, b = joint_rotations(estimate), joint_rotations(truth)
    angles = angle_differences(a, b)
    axes = _rotation_vectors(np.swapaxes(b, -1, -2) @ a)
    away = np.linalg.norm(joint_positions(estimate) - joint_positions(truth), axis=-1)
    return Score(
        angle_deg=float(angles.mean()),
        rms_deg=float(np.sqrt((np.degrees(axes) ** 2).mean(axis=0)).mean()),
        joint_cm=float(100.0 * away.mean()),
        per_joint_deg=angles.mean(axis=0),
        frames_deg=angles.mean(axis=1),
    )


def _rotation_vectors(rotations: Array) -> Array:
    from scipy.spatial.transform import Rotation

    flat = rotations.reshape(-1, 3, 3)
    return Rotation.from_matrix(flat).as_rotvec().reshape(*rotations.shape[:-2], 3)


def mean_pose_estimate(training: Array, headings: Array) -> Array:
    """Return the mean of training poses (N, 21, 3, 3), turned to true headings (T, 3, 3)."""
    return np.asarray(headings[:, None] @ mean_rotations(training)[None])


def best_training_estimate(training: Array, truth: Array, headings: Array) -> Array:
    """Return the training pose nearest to the truth, turned to the true heading: (T, 21, 3, 3)."""
    candidates = joint_rotations(training)
    out = np.empty_like(truth)
    for t, turn in enumerate(headings):
        wanted = joint_rotations(turn.T @ truth[t])
        out[t] = turn @ training[np.argmin(angle_differences(candidates, wanted[None]).mean(axis=1))]
    return out
