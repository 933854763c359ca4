"""Exemplars whose joints lie near the joints proposed by the finder.

The subspace of Sec. 5 compares clouds, in which an arm in front of the trunk has little weight. The proposals
(`depth_pose.detect.joint_net`) locate the arm. The exemplars whose joints are most similar to the
proposals are compared by rendered depth in addition to the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.rotations import nearest_rotation, unit_vectors
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, body_length
from depth_pose.match import _search_kernels as kernels
from depth_pose.match.placing import ScoredExemplars, unscored

_LEFT = [JOINT_INDEX["left_shoulder"], JOINT_INDEX["left_hip"]]
_RIGHT = [JOINT_INDEX["right_shoulder"], JOINT_INDEX["right_hip"]]
_NECK, _PELVIS = JOINT_INDEX["neck"], JOINT_INDEX["pelvis"]

_LAID = 16
"""Number of exemplars, the nearest with aligned trunks, that are aligned with the proposals by least
squares."""

_TAKEN = (8, 4)
"""Number of these that are compared, and number with left and right exchanged."""

_EVEN = 0.25
"""Offset in the weight of a joint; a joint whose expected error is half of one with confidence .5 gets half
of the maximum weight."""


class ProposedExemplars:
    """Finds exemplars by joints."""

    def __init__(self, bank: Bank) -> None:
        self._joints = bank.pose_nodes[:, JOINT_NODES]
        self._length = body_length(bank.body.nodes[JOINT_NODES])
        axes, middle = _trunk(self._joints)
        local = ((self._joints - middle[:, None]) @ axes).astype(np.float32)
        self._local = np.ascontiguousarray(local.reshape(bank.poses, -1).T)
        self._squares = np.ascontiguousarray((local**2).sum(axis=2).T)

    def find(self, measured: JointMeasurement | None, scale: float) -> ScoredExemplars | None:
        """Return the exemplars whose joints are nearest to a person's proposals; None without proposals."""
        if measured is None:
            return None
        named = measured.both.places
        weights = 1.0 / (_EVEN + 1.0 / np.maximum(measured.both.weights, 1e-3) - 1.0)
        weights /= weights[:1].sum()
        near = self._nearest(named, weights, scale)
        rows = np.repeat([0, 1], near.shape[1])
        gaps, turns, roots = _lay(scale * self._joints[near.ravel()], named[rows], weights[rows])
        best = gaps.reshape(near.shape).argsort(axis=1, kind="stable")
        taken = np.concatenate([n * near.shape[1] + best[n, :count] for n, count in enumerate(_TAKEN)])
        return unscored(near.ravel()[taken], turns[taken], roots[taken])

    def size(self, measured: JointMeasurement | None) -> float | None:
        """Estimate a person's size from the lengths between proposed joints; None without proposals."""
        if measured is None:
            return None
        return body_length(measured.places) / self._length

    def _nearest(
        self, named: NDArray[np.float64], weights: NDArray[np.float64], scale: float
    ) -> NDArray[np.int64]:
        """Return the exemplars (2, `_LAID`) nearest to joints (2, 19, 3) with aligned trunks."""
        axes, middle = _trunk(named)
        local = ((named - middle[:, None]) @ axes) / scale
        pulls = (2.0 * weights[:, :, None] * local).reshape(2, -1).astype(np.float32)
        distance = np.empty((2, self._local.shape[1]), np.float32)
        kernels.joint_distances(self._squares, self._local, weights.astype(np.float32), pulls, distance)
        count = min(_LAID, distance.shape[1])
        return np.asarray(kernels.least_of_rows(distance, count))


def _lay(
    own: NDArray[np.float64], joints: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Align joints (K, 19, 3) with others: residuals (K,), rotations, pelvis places (`fit_rigid`)."""
    share = weights[:, None]
    own_middle, middle = share @ own, share @ joints
    turns = nearest_rotation(
        (joints - middle).transpose(0, 2, 1) @ (weights[:, :, None] * (own - own_middle))
    )
    back = turns.transpose(0, 2, 1)
    gaps = (own - own_middle) @ back - (joints - middle)
    left = (share @ (gaps**2)).sum(axis=(1, 2))
    return left, turns, (middle - own_middle @ back)[:, 0]


def _trunk(joints: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute the axes (N, 3, 3), in columns, and centres (N, 3) of the trunks of joints (N, 19, 3)."""
    up = unit_vectors(joints[:, _NECK] - joints[:, _PELVIS])
    across = joints[:, _LEFT].mean(axis=1) - joints[:, _RIGHT].mean(axis=1)
    across = unit_vectors(across - (across * up).sum(axis=1, keepdims=True) * up)
    axes = np.empty((len(joints), 3, 3))
    axes[:, :, 0], axes[:, :, 1] = across, up
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        axes[:, a, 2] = across[:, b] * up[:, c] - across[:, c] * up[:, b]
    return axes, joints[:, _LEFT + _RIGHT].mean(axis=1)
