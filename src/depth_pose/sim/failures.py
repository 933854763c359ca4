"""Failures put into right skeletons, to see whether they are found: `KINDS` by name.

``flip``: the person taken for their own back view. ``legs``: left and right leg exchanged.
``arm``: one arm somewhere else. ``jump``: another pose altogether. They are what trackers from
depth are known to do; bones keep their lengths, and the scores are those of the wrong poses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.body.rendered_depth import DepthComparer
from depth_pose.core.config import MatchConfig
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, MIRROR_NODES, NODE_INDEX, forward_kinematics
from depth_pose.core.types import Fitted
from depth_pose.recover.confidence import fit_confidence, report_joints
from depth_pose.refine.articulated import BodyPose
from depth_pose.refine.skeleton_pose import pose_from_nodes, pose_from_skeleton
from depth_pose.track.person import Person

_ARMS = [
    [NODE_INDEX[f"{s}_{n}"] for n in ("clavicle", "shoulder", "elbow", "wrist")] for s in ("left", "right")
]
_LEGS = [[NODE_INDEX[f"{s}_{n}"] for n in ("hip", "knee", "ankle", "foot")] for s in ("left", "right")]
_ABOUT_FACE = np.diag([-1.0, 1.0, -1.0])
"""Half a turn about the vertical."""


def _flip(bank: Bank, pose: BodyPose, rng: np.random.Generator) -> BodyPose:
    return replace(pose, rotations=pose.rotations[MIRROR_NODES] @ _ABOUT_FACE)


def _exchange_legs(bank: Bank, pose: BodyPose, rng: np.random.Generator) -> BodyPose:
    nodes = forward_kinematics(pose.rotations, pose.root, bank.body.nodes, pose.scale)
    wrong, rotations = nodes.copy(), pose.rotations.copy()
    for mine, other in (_LEGS, _LEGS[::-1]):
        wrong[mine[1:]], rotations[mine] = nodes[other[1:]], pose.rotations[other]
    return replace(pose_from_nodes(bank.body, rotations, wrong, pose.scale), root=pose.root)


def _move_arm(bank: Bank, pose: BodyPose, rng: np.random.Generator) -> BodyPose:
    arm, chest = _ARMS[int(rng.integers(2))], NODE_INDEX["chest"]
    taken = bank.rotations(int(rng.integers(bank.poses)))
    rotations = pose.rotations.copy()
    rotations[arm] = rotations[chest] @ taken[chest].T @ taken[arm]
    return replace(pose, rotations=rotations)


def _jump(bank: Bank, pose: BodyPose, rng: np.random.Generator) -> BodyPose:
    taken = bank.rotations(int(rng.integers(bank.poses)))
    return replace(pose, rotations=pose.rotations[0] @ taken[0].T @ taken)


KINDS: dict[str, Callable[[Bank, BodyPose, np.random.Generator], BodyPose]] = {
    "flip": _flip,
    "legs": _exchange_legs,
    "arm": _move_arm,
    "jump": _jump,
}
"""Makers of wrong poses from right ones."""


def fail(kind: str, fitted: Fitted, person: Person, bank: Bank, rng: np.random.Generator) -> Fitted:
    """Insert a failure into a fitted skeleton.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    fitted : Fitted
        A right one, made with the default `MatchConfig.score_band`, as all are that this is used on:
        the wrong pose is compared with the same band, for scores of other bands are not alike.
    person : Person
        The input that it answers, with which the wrong pose is compared as a fit would be.
    bank : Bank
        Source of wrong arms and wrong poses.
    rng : Generator

    Returns
    -------
    Fitted
        With the score, confidence, residual and joint states of the wrong pose.
    """
    body = bank.body
    pose = KINDS[kind](bank, pose_from_skeleton(body, fitted.skeleton), rng)
    posed = body.pose(pose.rotations, pose.root, pose.scale)
    seen = DepthComparer(person.coarse, MatchConfig().score_band).compare(posed.vertices, body.faces)
    positions = posed.nodes[JOINT_NODES]
    report = report_joints(positions, pose.scale, person, seen.score)
    skeleton = replace(
        fitted.skeleton,
        confidence=float(np.float32(fit_confidence(seen.score))),
        residual=float(np.float32(seen.gap)),
        positions=positions,
        quats_xyzw=matrix_to_quat(pose.rotations[JOINT_NODES]),
        joint_confidence=report.confidence.astype(np.float32),
        joint_states=report.states,
    )
    return Fitted(skeleton, seen.score)
