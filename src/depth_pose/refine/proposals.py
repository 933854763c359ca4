"""Limbs turned toward the measured joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINT_NODES, JOINTS
from depth_pose.refine.skeleton_pose import aim_limbs


def _of_limbs(*names: str) -> NDArray[np.bool_]:
    joints = {f"{side}_{name}" for side in ("left", "right") for name in names}
    return np.array([joint in joints for joint in JOINTS])


_LEGS, _ARMS = _of_limbs("knee", "ankle"), _of_limbs("elbow", "wrist")

_SURE = 0.2
"""Least confidence of a proposal that a limb is aimed at: an expected error of 0.2 m; chosen on development
clips."""

_FAR = 5.0
"""Arms are aimed at measured joints that are farther away than this, standard deviations."""


def aim_at_proposals(body: Body, pose: BodyPose, measured: JointMeasurement | None) -> list[BodyPose]:
    """Turn a pose's legs, and arms that are far off, toward a person's proposed joints.

    Nearby arms are unchanged, since the limb search locates visible arms better than proposals do.

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
    proposed = measured.named_like(nodes[JOINT_NODES])
    off = np.linalg.norm(nodes[JOINT_NODES] - proposed.places, axis=1) / proposed.sigmas[:, 0]
    is_sure = proposed.confidence >= _SURE
    aimed = []
    for chosen in (_LEGS & is_sure, _ARMS & is_sure & (off > _FAR)):
        if chosen.any():
            goal = nodes.copy()
            goal[JOINT_NODES[chosen]] = proposed.places[chosen]
            aimed.append(BodyPose(aim_limbs(body, pose.rotations, goal), pose.root, pose.scale))
    return aimed
