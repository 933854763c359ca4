"""Exemplars for a person whose lower body lies below the image.

The axes and the centre of half a body differ from those of a whole one, so the bank's views do not match it.
But such a person stands or sits upright with the head in view. Therefore upright exemplars, rotated in steps
about the camera's vertical, are aligned at the head. The comparison by rendered depth, which ignores
everything beyond the image, selects among them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.bank.canonical import CanonicalAxes
from depth_pose.bank.views import view_rotation
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, matrix_to_quat, quat_to_matrix
from depth_pose.core.skeleton import NODE_INDEX
from depth_pose.match.placing import ExemplarViews
from depth_pose.match.search import Nearest

_POSES = 12
"""Approximate number of upright poses that are tried; set by hand."""
_TURNS = np.radians([0.0, -30.0, 30.0, -60.0, 60.0, 180.0])
"""Rotations about the vertical (radians); set by hand."""
_HEAD_M = 0.22
"""Height of the head's points below the highest point (m on the 1.75 m body); set by hand."""
_CANONICAL_CAMERA = R_CAMERA_FACING_MODEL.copy()
"""Right, up and toward the camera, in the camera frame: the axes of a person who faces it.

A copy, because numba compiles kernels again for read-only arrays.
"""


def head_axes(points: NDArray[np.float64], scale: float) -> CanonicalAxes:
    """Compute level axes at the centre of the head's visible points."""
    top = np.percentile(points[:, 1], 0.5)
    head = points[points[:, 1] < top + scale * _HEAD_M]
    return CanonicalAxes(_CANONICAL_CAMERA, head.mean(axis=0))


class UprightExemplars:
    """Upright poses of a bank, seen from all sides, aligned at the head."""

    def __init__(self, bank: Bank) -> None:
        rotations = quat_to_matrix(bank.pose_quats.astype(np.float64))
        straight = rotations[:, [NODE_INDEX[n] for n in ("pelvis", "chest", "head")], 1, 1].min(axis=1)
        numbers = np.sort(np.argsort(-straight, kind="stable")[: max(_POSES, bank.poses // 4)])
        numbers = numbers[:: max(1, len(numbers) // _POSES)][:_POSES]
        head = np.argmax(bank.body.weights, axis=1) == NODE_INDEX["head"]
        turns = np.stack([_CANONICAL_CAMERA @ view_rotation(a, 0.0) for a in _TURNS])
        origins = np.empty((len(numbers), len(turns), 3), np.float32)
        for k, number in enumerate(numbers):
            skull = bank.body.pose(rotations[number], np.zeros(3)).vertices[head]
            for t, turn in enumerate(turns):
                toward = skull @ turn[2]
                origins[k, t] = skull[toward > np.median(toward)].mean(axis=0)  # the visible half
        self.views = ExemplarViews(
            numbers=numbers,
            view_quats=np.tile(matrix_to_quat(turns).astype(np.float32), (len(numbers), 1, 1)),
            view_origins=origins,
        )
        count = len(numbers) * len(turns)
        self.all = Nearest(np.arange(count), np.zeros(count, np.float32))
