"""Joint proposals and poses: aiming limbs at proposals, and the distance of joints from them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINT_NODES, JOINTS, Nodes
from depth_pose.refine import _aim_kernels as kernels
from depth_pose.refine.skeleton_pose import aim_limbs


def _of_limbs(*names: str) -> NDArray[np.bool_]:
    joints = {f"{side}_{name}" for side in ("left", "right") for name in names}
    return np.array([joint in joints for joint in JOINTS])


_LEGS, _ARMS = _of_limbs("knee", "ankle"), _of_limbs("elbow", "wrist")

_SURE = 0.2
"""Least confidence of a proposal that a limb is aimed at: an expected error of 0.2 m; chosen on development
clips."""

_FAR = 5.0
"""Maximum distance that counts between a joint and its proposal, standard deviations; 8 is the same. Arms are
aimed at proposals that are farther away."""


def aim_at_proposals(body: Body, pose: BodyPose, measured: JointMeasurement | None) -> list[BodyPose]:
    """Turn a pose's legs, and arms that are far off, toward a person's proposed joints.

    Arms that are near stay: where they are visible, the limb search finds them better than proposals do.

    Parameters
    ----------
    body : Body
    pose : BodyPose
        In the camera frame; defines left and right, and keeps its trunk.
    measured : JointMeasurement or None

    Returns
    -------
    list of BodyPose
        One with other legs and one with other arms; none where no proposal is confident enough.
    """
    if measured is None:
        return []
    nodes = body.place(pose.rotations, pose.root, pose.scale)
    proposed = named_alike(nodes[JOINT_NODES], measured)
    off = np.linalg.norm(nodes[JOINT_NODES] - proposed.places, axis=1) / proposed.sigmas[:, 0]
    is_sure = proposed.confidence >= _SURE
    aimed = []
    for chosen in (_LEGS & is_sure, _ARMS & is_sure & (off > _FAR)):
        if chosen.any():
            goal = nodes.copy()
            goal[JOINT_NODES[chosen]] = proposed.places[chosen]
            aimed.append(BodyPose(aim_limbs(body, pose.rotations, goal), pose.root, pose.scale))
    return aimed


def is_named_alike(joints: NDArray[np.float64], measured: JointMeasurement) -> bool:
    """Check whether joints (19, 3) are nearer to a person's proposals as named than with sides exchanged."""
    proposals = measured.both
    return bool(kernels.nearer_naming(joints, proposals.places, proposals.weights) == 0)


def from_proposals(nodes: Nodes, measured: JointMeasurement | None) -> float:
    """Compute the mean distance of a pose's joints from a person's proposals, standard deviations."""
    if measured is None:
        return 0.0
    return kernels.mean_deviation(nodes[JOINT_NODES], measured.places, measured.sigma, _FAR)


class Named(NamedTuple):
    """Proposed joints (19, 3), confidences (19,) and deviations across and along the ray (19, 2), float64."""

    places: NDArray[np.float64]
    confidence: NDArray[np.float64]
    sigmas: NDArray[np.float64]


def named_alike(own: NDArray[np.float64], measured: JointMeasurement) -> Named:
    """Return a person's proposals with the left/right naming nearer to the joints ``own``, (19, 3)."""
    proposals = measured.both
    side = kernels.nearer_naming(own, proposals.places, proposals.weights)
    return Named(proposals.places[side], proposals.weights[side], proposals.sigmas[side])
