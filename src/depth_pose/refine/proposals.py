"""Joint proposals and poses: aiming legs at proposals, and the distance of joints from them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, JOINTS
from depth_pose.core.types import FoundPerson
from depth_pose.refine import _aim_kernels as kernels
from depth_pose.refine.skeleton_pose import aim_limbs
from depth_pose.track.target import name_proposals

_AIMED = np.zeros(len(JOINTS), bool)
_AIMED[[JOINT_INDEX[f"{s}_{n}"] for s in ("left", "right") for n in ("knee", "ankle")]] = True

_SURE = 0.2
"""Least confidence of a proposal that a leg is aimed at: an expected error of 0.2 m; chosen on development
clips."""

_FAR = 5.0
"""Maximum distance that counts between a joint and its proposal, standard deviations; 8 is the same."""


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
    proposed = named_alike(nodes[JOINT_NODES], found)
    sure = _AIMED & (proposed.confidence >= _SURE)
    if not sure.any():
        return None
    nodes[JOINT_NODES[sure]] = proposed.places[sure]
    return BodyPose(aim_limbs(body, pose.rotations, nodes), pose.root, pose.scale)


def from_proposals(nodes: NDArray[np.float64], found: FoundPerson) -> float:
    """Compute the mean distance of a pose's joints from a person's proposals, standard deviations."""
    if len(found.proposals) != len(JOINTS):
        return 0.0
    return kernels.mean_deviation(nodes[JOINT_NODES], found.proposals, found.proposal_sigma, _FAR)


class Named(NamedTuple):
    """Proposed joints (19, 3), confidences (19,) and deviations across and along the ray (19, 2), float64."""

    places: NDArray[np.float64]
    confidence: NDArray[np.float64]
    sigmas: NDArray[np.float64]


def named_alike(own: NDArray[np.float64], found: FoundPerson) -> Named:
    """Return a person's proposals with the left/right naming nearer to the joints ``own``, (19, 3)."""
    proposals = name_proposals(found)
    side = kernels.nearer_naming(own, proposals.places, proposals.weights)
    return Named(proposals.places[side], proposals.weights[side], proposals.sigmas[side])
