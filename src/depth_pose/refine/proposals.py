"""Joint proposals and poses: aiming legs at proposals, and the distance of joints from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, JOINTS, MIRROR_JOINTS
from depth_pose.core.types import FoundPerson
from depth_pose.refine import _aim_kernels as kernels
from depth_pose.refine.skeleton_pose import aim_limbs

_AIMED = np.zeros(len(JOINTS), bool)
_AIMED[[JOINT_INDEX[f"{s}_{n}"] for s in ("left", "right") for n in ("knee", "ankle")]] = True

_SURE = 0.2
"""Least confidence of a proposal that a leg is aimed at: an expected error of 0.2 m; chosen on development
clips."""

_FAR_M = 0.3
"""Maximum distance (m) that counts between a joint and its proposal; set by hand."""


def aim_legs(body: Body, pose: BodyPose, found: FoundPerson) -> BodyPose | None:
    """Turn a pose's legs toward a person's proposed knees and ankles.

    Arms are excluded: where they are visible, the limb search finds them better than proposals do.

    Parameters
    ----------
    body : Body
    pose : BodyPose
        In the camera frame; defines left and right, and keeps its trunk.
    found : FoundPerson

    Returns
    -------
    BodyPose or None
        None if no proposal is confident enough.
    """
    if len(found.proposals) != len(JOINTS):
        return None
    nodes = body.place(pose.rotations, pose.root, pose.scale)
    joints, confidence = named_alike(nodes[JOINT_NODES], found)
    sure = _AIMED & (confidence >= _SURE)
    if not sure.any():
        return None
    nodes[JOINT_NODES[sure]] = joints[sure]
    return BodyPose(aim_limbs(body, pose.rotations, nodes), pose.root, pose.scale)


def from_proposals(nodes: NDArray[np.float64], found: FoundPerson) -> float:
    """Compute the confidence-weighted distance (m) of a pose's joints from a person's proposals."""
    if len(found.proposals) != len(JOINTS):
        return 0.0
    return kernels.mean_gap(nodes[JOINT_NODES], found.proposals, found.proposal_confidence, _FAR_M)


def named_alike(
    own: NDArray[np.float64], found: FoundPerson
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return proposed joints and confidences (19,), with the left/right naming nearer to ``own``."""
    places = np.stack([found.proposals, found.proposals[MIRROR_JOINTS]])
    weights = np.stack([found.proposal_confidence, found.proposal_confidence[MIRROR_JOINTS]])
    side = kernels.nearer_naming(own, places, weights)
    return places[side], weights[side]
