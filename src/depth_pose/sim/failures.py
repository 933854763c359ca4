"""Failures inserted into correct skeletons, for testing their detection: `KINDS` by name.

``flip``: the back view of the person. ``legs``: left and right leg exchanged. ``arm``: one arm in
another pose. ``jump``: another pose altogether. They are typical failures of depth
trackers; bones keep their lengths, and the scores are those of the wrong poses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.core.skeleton import NODE_INDEX, forward_kinematics
from depth_pose.refine.skeleton_pose import about_face, pose_from_nodes
from depth_pose.track.person_view import PersonView

_ARMS = [
    [NODE_INDEX[f"{s}_{n}"] for n in ("clavicle", "shoulder", "elbow", "wrist")] for s in ("left", "right")
]
_LEGS = [[NODE_INDEX[f"{s}_{n}"] for n in ("hip", "knee", "ankle", "foot")] for s in ("left", "right")]


def _flip(bank: Bank, pose: BodyPose, rng: np.random.Generator) -> BodyPose:
    return about_face(pose)


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
"""Functions that make wrong poses from right ones."""


def fail(kind: str, fitted: Fitted, person: PersonView, bank: Bank, rng: np.random.Generator) -> Fitted:
    """Apply a failure to a fitted body.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    fitted : Fitted
        A correct one.
    person : PersonView
        The person it was fitted to, with which the wrong pose is compared as a fit would be.
    bank : Bank
        Source of the poses of a wrong arm, or of a wrong pose.
    rng : Generator

    Returns
    -------
    Fitted
        With the wrong pose, and its comparison with the input.
    """
    body = bank.body
    pose = KINDS[kind](bank, fitted.pose, rng)
    posed = body.pose(pose.rotations, pose.root, pose.scale)
    seen = person.comparer.compare(posed.vertices, body.faces)
    wrong = FittedBody(pose, posed.vertices, posed.nodes)
    answer = replace(fitted, body=wrong, build=np.zeros(0, np.float32))
    return replace(answer, score=seen.score, mean_depth_error=seen.mean_depth_error)
