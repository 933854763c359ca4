"""Sources of hypotheses: the state of a person, the matched exemplars, and the measured joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.body import Body
from depth_pose.body.pose import BodyPose
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.pose_match import PoseMatch
from depth_pose.core.skeleton import JOINT_NODES, JOINTS
from depth_pose.refine.skeleton_pose import aim_limbs
from depth_pose.refine.solver import Hypothesis
from depth_pose.track.state import PersonState


def _of_limbs(*names: str) -> NDArray[np.bool_]:
    joints = {f"{side}_{name}" for side in ("left", "right") for name in names}
    return np.array([joint in joints for joint in JOINTS])


_LIMBS = _of_limbs("knee", "ankle"), _of_limbs("elbow", "wrist")
"""The joints of the legs and of the arms that are aimed at."""

_SURE = 0.2
"""Least confidence of a measured joint that a limb is aimed at: an expected error of 0.2 m; chosen on
development clips."""


def from_previous(state: PersonState) -> list[Hypothesis]:
    """Return the fit of the frame before, at the size in use; none in the first frame."""
    pose = state.answer.pose
    return [] if pose is None else [Hypothesis(replace(pose, scale=state.shape.scale), "previous")]


def from_exemplars(match: PoseMatch, state: PersonState, bank: Bank) -> list[Hypothesis]:
    """Return the matched exemplars, at the size in use."""
    return [Hypothesis(bank.pose(c, state.shape.scale), "exemplar") for c in match.candidates]


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
    nodes = body.place(pose.rotations, pose.root, pose.scale)
    proposed = measured.named_like(nodes[JOINT_NODES])
    turned = []
    for limbs in _LIMBS:
        aimed = limbs & (proposed.confidence >= _SURE)
        if aimed.any():
            goal = nodes.copy()
            goal[JOINT_NODES[aimed]] = proposed.places[aimed]
            turned.append(BodyPose(aim_limbs(body, pose.rotations, goal), pose.root, pose.scale))
    return [Hypothesis(p, "joints") for p in turned]
