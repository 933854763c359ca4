"""Exemplars for a person whose lower body lies below the image.

The axes and the middle of half a body are not those of a whole one, so the bank's views do not
match it. But such a person stands or sits upright, and their head is in view: upright exemplars,
turned in steps about the camera's vertical, are hung up by the head. The comparison by rendered
depth, which leaves out what lies beyond the image, and the limb search do the rest.
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
"""Upright poses that are tried, about. Set by hand, not swept."""
_TURNS = np.radians([0.0, -30.0, 30.0, -60.0, 60.0, 180.0])
"""Turns about the vertical at which each is seen, radians. Set by hand, not swept."""
_HEAD_M = 0.22
"""Height of the head's points below the highest, metres on the 1.75 m body. Set by hand, not swept."""
_CANONICAL_CAMERA = R_CAMERA_FACING_MODEL.copy()
"""Right, up and toward the camera, in the camera frame: the axes of somebody who faces it.

A copy, because kernels are compiled once more for an array that cannot be written.
"""


def head_axes(points: NDArray[np.float64], scale: float) -> CanonicalAxes:
    """Give level axes at the middle of the head's visible points."""
    top = np.percentile(points[:, 1], 0.5)
    head = points[points[:, 1] < top + scale * _HEAD_M]
    return CanonicalAxes(_CANONICAL_CAMERA, head.mean(axis=0))


class UprightExemplars:
    """Upright poses of a bank, seen from all around, hung up by the head."""

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
                origins[k, t] = skull[toward > np.median(toward)].mean(axis=0)  # the half that is seen
        self.views = ExemplarViews(
            numbers=numbers,
            view_quats=np.tile(matrix_to_quat(turns).astype(np.float32), (len(numbers), 1, 1)),
            view_origins=origins,
        )
        count = len(numbers) * len(turns)
        self.all = Nearest(np.arange(count), np.zeros(count, np.float32))
