"""Sources of hypotheses: the state of a person, the matched exemplars, and the measured joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.pose_match import PoseMatch
from depth_pose.core.skeleton import JOINTS
from depth_pose.refine import _aim_kernels as kernels
from depth_pose.refine.skeleton_pose import AIMED
from depth_pose.refine.solver import Hypothesis


def _of_limbs(*names: str) -> NDArray[np.bool_]:
    joints = {f"{side}_{name}" for side in ("left", "right") for name in names}
    return np.array([joint in joints for joint in JOINTS])


_LIMBS = np.array([_of_limbs("knee", "ankle"), _of_limbs("elbow", "wrist")])
"""The joints of the legs and of the arms that are aimed at, (2, 19)."""

_SURE = 0.2
"""Least confidence of a measured joint that a limb is aimed at: an expected error of 0.2 m; chosen on
development clips."""


def from_previous(pose: BodyPose | None, scale: float) -> list[Hypothesis]:
    """Return the fit of the frame before, at the size in use; none in the first frame."""
    return [] if pose is None else [Hypothesis(BodyPose(pose.rotations, pose.root, scale), "previous")]


def from_exemplars(match: PoseMatch, scale: float, bank: Bank) -> list[Hypothesis]:
    """Return the matched exemplars, at the size in use."""
    return [Hypothesis(pose, "exemplar") for pose in bank.poses_of(match.candidates, scale)]


def from_joints(body: Body, pose: BodyPose, measured: JointMeasurement | None) -> list[Hypothesis]:
    """Return a pose with legs, and with arms, turned to the measured joints that are sure enough.

    Parameters
    ----------
    body : Body
        The bank's.
    pose : BodyPose
        In the camera frame; defines left and right, and keeps its trunk.
    measured : JointMeasurement or None
    """
    if measured is None:
        return []
    rotations = np.empty((len(_LIMBS), *pose.rotations.shape))
    aimed = kernels.aim_at_measured(
        body.nodes, pose.rotations, pose.root, pose.scale, measured.both, _LIMBS, _SURE, AIMED, rotations
    )
    return [Hypothesis(BodyPose(r, pose.root, pose.scale), "joints") for r in rotations[aimed]]
