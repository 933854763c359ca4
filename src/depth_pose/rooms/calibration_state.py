"""The unknowns of a room's least-squares problem, and its normal equations.

Unknowns of each camera, `SIZE` numbers: a small motion of its pose in the room (rotation vector, then
translation: ``q -> q + w x q + t``), its clock's offset (s), and its depth bias, by which people appear too
near along its rays (m). The bias is needed because the joints of a fitted body lie up to a few centimetres
too near in every camera, which no transform explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import cross_matrix, rotvec_to_matrix

Array = NDArray[np.float64]

SIZE = 8
"""Number of unknowns of a camera."""
OFFSET, NEAR = 6, 7
"""Indices of the clock offset and of the depth bias."""
NEAR_M = 0.03
"""Depth bias, mean over sensors (m)."""


@dataclass(frozen=True)
class CameraState:
    """The current estimate of one camera.

    Attributes
    ----------
    T_room_camera : (4, 4) float64
    offset : float
        Its clock minus the room's, seconds.
    near : float
        Depth bias: distance by which the pelvis appears too near along its rays, metres.
    """

    T_room_camera: Array
    offset: float = 0.0
    near: float = NEAR_M

    def to_room(self, points: Array) -> Array:
        """Points (..., 3) of the camera frame in the room frame, metres."""
        return np.asarray(points @ self.T_room_camera[:3, :3].T + self.T_room_camera[:3, 3])

    def moved(self, step: Array) -> CameraState:
        """Apply a step (SIZE,) of the unknowns."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotvec_to_matrix(step[:3]), step[3:6]
        return replace(
            self,
            T_room_camera=T @ self.T_room_camera,
            offset=self.offset + float(step[OFFSET]),
            near=self.near + float(step[NEAR]),
        )


class Normal:
    """Normal equations of all cameras: ``matrix`` (M, M) and ``vector`` (M,), M = `SIZE` times cameras."""

    def __init__(self, cameras: int) -> None:
        self.matrix = np.zeros((cameras * SIZE, cameras * SIZE))
        self.vector = np.zeros(cameras * SIZE)

    def add(self, rows: Sequence[tuple[int, Array]], residual: Array, weight: Array) -> None:
        """Add residuals (N,) with weights (N,), and their derivatives (N, SIZE) by cameras."""
        for a, Ja in rows:
            weighted = Ja * weight[:, None]
            self.vector[a * SIZE : (a + 1) * SIZE] += weighted.T @ residual
            for b, Jb in rows:
                self.matrix[a * SIZE : (a + 1) * SIZE, b * SIZE : (b + 1) * SIZE] += weighted.T @ Jb

    def step(self) -> Array:
        """Return the Gauss-Newton step (cameras, SIZE)."""
        return np.asarray(-np.linalg.solve(self.matrix, self.vector).reshape(-1, SIZE))


def motion_rows(points: Array) -> Array:
    """Return the derivatives (N, 3, SIZE) of points (N, 3) in the room by their camera's motion."""
    rows = np.zeros((len(points), 3, SIZE))
    x, y, z = points.T
    rows[:, :, :3] = -cross_matrix(x, y, z)
    rows[:, :, 3:6] = np.eye(3)
    return rows
