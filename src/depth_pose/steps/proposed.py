"""Exemplars whose joints lie where the finder's second look proposes them.

The subspace of Sec. 5 compares clouds, in which an arm before the trunk hardly counts. The proposals
(`depth_pose.people.joint_finder`) say where the arm is; the exemplars whose joints lie most like that
are compared by rendered depth beside the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.core.rotations import nearest_rotation, quat_to_matrix
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, JOINTS, MIRROR_JOINTS, forward_kinematics
from depth_pose.core.types import FoundPerson
from depth_pose.steps.placing import Placed, unscored

_LEFT = [JOINT_INDEX["left_shoulder"], JOINT_INDEX["left_hip"]]
_RIGHT = [JOINT_INDEX["right_shoulder"], JOINT_INDEX["right_hip"]]
_NECK, _PELVIS = JOINT_INDEX["neck"], JOINT_INDEX["pelvis"]

_LAID = 32
"""Exemplars, the nearest with trunk on trunk, that are laid over the proposals as well as can be."""

_TAKEN = (8, 4)
"""Of these, how many are compared; and how many for left and right taken for each other."""

_EVEN = 0.25
"""Joints whose claimed error is half of that of even confidence weigh half of the most that one can."""


class ProposedExemplars:
    """Finds exemplars by joints."""

    def __init__(self, bank: Bank) -> None:
        rotations = quat_to_matrix(bank.pose_quats.astype(np.float64))
        nodes = forward_kinematics(rotations, np.zeros((bank.poses, 3)), bank.body.nodes)
        self._joints = nodes[:, JOINT_NODES]
        axes, middle = _trunk(self._joints)
        local = (self._joints - middle[:, None]) @ axes
        self._local = local.reshape(bank.poses, -1).astype(np.float32)
        self._squares = (self._local**2).reshape(local.shape).sum(axis=2)

    def find(self, found: FoundPerson, scale: float) -> Placed | None:
        """Give the exemplars whose joints lie most like a person's; None without proposals."""
        if len(found.proposals) != len(JOINTS):
            return None
        joints = found.proposals.astype(np.float64)
        confidence = np.maximum(found.proposal_confidence.astype(np.float64), 1e-3)
        weights = 1.0 / (_EVEN + 1.0 / confidence - 1.0)
        weights /= weights.sum()
        named = [(joints, weights), (joints[MIRROR_JOINTS], weights[MIRROR_JOINTS])]
        rows, turns, roots = zip(
            *(self._lay(j, w, scale, n) for (j, w), n in zip(named, _TAKEN, strict=True)), strict=True
        )
        return unscored(np.concatenate(rows), np.concatenate(turns), np.concatenate(roots))

    def _lay(
        self, joints: NDArray[np.float64], weights: NDArray[np.float64], scale: float, count: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Give number, rotation and pelvis of the exemplars that come nearest."""
        axes, middle = _trunk(joints[None])
        local = ((joints - middle[0]) @ axes[0]) / scale
        pull = (weights[:, None] * local).astype(np.float32).reshape(-1)
        distance = self._squares @ weights.astype(np.float32) - 2.0 * (self._local @ pull)
        near = np.argpartition(distance, min(_LAID, len(distance) - 1))[:_LAID]
        own = scale * self._joints[near]
        own_middle, middle_ = weights @ own, weights @ joints
        spread = np.einsum("j,kja,jb->kba", weights, own - own_middle[:, None], joints - middle_)
        turns = nearest_rotation(spread)
        gaps = (own - own_middle[:, None]) @ turns.transpose(0, 2, 1) - (joints - middle_)
        best = np.argsort((gaps**2).sum(axis=2) @ weights, kind="stable")[:count]
        roots = middle_ - np.einsum("kab,kb->ka", turns[best], own_middle[best])
        return near[best], turns[best], roots


def _trunk(joints: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Axes (N, 3, 3), in columns, and middles (N, 3) of the trunks of (N, 19, 3) joints."""
    up = _unit(joints[:, _NECK] - joints[:, _PELVIS])
    across = joints[:, _LEFT].mean(axis=1) - joints[:, _RIGHT].mean(axis=1)
    across = _unit(across - (across * up).sum(axis=1, keepdims=True) * up)
    axes = np.stack([across, up, np.cross(across, up)], axis=2)
    return axes, joints[:, _LEFT + _RIGHT].mean(axis=1)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
