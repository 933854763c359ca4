"""Limbs aimed at where joints are proposed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, JOINTS, MIRROR_JOINTS, forward_kinematics
from depth_pose.core.types import FoundPerson
from depth_pose.fit.articulated import BodyPose
from depth_pose.fit.skeleton_pose import pose_from_nodes

_AIMED = np.zeros(len(JOINTS), bool)
_AIMED[[JOINT_INDEX[f"{s}_{n}"] for s in ("left", "right") for n in ("elbow", "wrist", "knee", "ankle")]] = (
    True
)

_SURE = 0.2
"""Least confidence of a proposal that a limb is aimed at: an expected error of 0.14 m."""


def aim_limbs(body: Body, pose: BodyPose, found: FoundPerson) -> BodyPose | None:
    """Turn a pose's limbs toward a person's proposed elbows, wrists, knees and ankles.

    Parameters
    ----------
    body : Body
    pose : BodyPose
        In the camera frame; says which side is which, and keeps the trunk.
    found : FoundPerson

    Returns
    -------
    BodyPose or None
        None where no proposal is sure enough.
    """
    if len(found.proposals) != len(JOINTS):
        return None
    nodes = forward_kinematics(pose.rotations, pose.root, body.nodes, pose.scale)
    own = nodes[JOINT_NODES]
    joints, confidence = _named_alike(own, found)
    sure = _AIMED & (confidence >= _SURE)
    if not sure.any():
        return None
    nodes[JOINT_NODES[sure]] = joints[sure]
    return BodyPose(pose_from_nodes(body, pose.rotations, nodes, pose.scale).rotations, pose.root, pose.scale)


def _named_alike(
    own: NDArray[np.float64], found: FoundPerson
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Joints and confidences with left and right such that they are nearer to a pose's."""
    joints, confidence = found.proposals.astype(np.float64), found.proposal_confidence
    mirrored, other = joints[MIRROR_JOINTS], confidence[MIRROR_JOINTS]
    gaps = [float(w @ ((j - own) ** 2).sum(axis=1)) for j, w in ((joints, confidence), (mirrored, other))]
    return (joints, confidence) if gaps[0] <= gaps[1] else (mirrored, other)
