"""Initial poses of the fit to several cameras: each one's own answer, and the best limbs combined."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.pose import BodyPose
from depth_pose.core.skeleton import JOINT_INDEX, NODE_INDEX

_LIMBS: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = tuple(
    (tuple(f"{side}_{node}" for node in nodes), tuple(f"{side}_{joint}" for joint in joints))
    for side in ("left", "right")
    for nodes, joints in (
        (("clavicle", "shoulder", "elbow", "wrist"), ("shoulder", "elbow", "wrist")),
        (("hip", "knee", "ankle", "foot"), ("hip", "knee", "ankle", "foot")),
    )
)
"""Nodes of each limb, and the joints whose confidence decides between cameras."""

_TRUNK = [JOINT_INDEX[name] for name in ("pelvis", "spine", "chest", "neck")]


def best_limbs(
    poses: Sequence[BodyPose], confidence: Sequence[NDArray[np.floating]], scale: float
) -> BodyPose:
    """Combine poses of one person: the trunk and each limb from the camera with the highest confidence.

    Parameters
    ----------
    poses : sequence of BodyPose
        Room frame.
    confidence : sequence of (19,) float
        Confidence of each pose's joints.
    scale : float
        Of the result.
    """
    surest = int(np.argmax([c[_TRUNK].mean() for c in confidence]))
    rotations = poses[surest].rotations.copy()
    for nodes, joints in _LIMBS:
        columns = [JOINT_INDEX[name] for name in joints]
        best = int(np.argmax([c[columns].mean() for c in confidence]))
        rows = [NODE_INDEX[name] for name in nodes]
        rotations[rows] = poses[best].rotations[rows]
    weight = np.array([c[_TRUNK].mean() for c in confidence])
    root = weight @ np.stack([pose.root for pose in poses]) / weight.sum()
    return BodyPose(rotations, root, scale)
