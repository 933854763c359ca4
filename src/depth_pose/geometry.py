"""Rotations and quaternions (x, y, z, w), vectorised."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def quat_to_matrix(quat_xyzw: Array) -> Array:
    """Rotation matrices, shape (..., 3, 3), of unit quaternions, shape (..., 4)."""
    x, y, z, w = np.moveaxis(np.asarray(quat_xyzw, np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def matrix_to_quat(matrix: Array) -> Array:
    """Give unit quaternions (x, y, z, w), shape (..., 4), of rotations, shape (..., 3, 3); w >= 0.

    Takes the largest of the four components first, which keeps it accurate at every angle.
    """
    m = np.asarray(matrix, np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    squares = np.stack([1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz], -1)
    a, b, c = m[..., 2, 1], m[..., 0, 2], m[..., 1, 0]
    d, e, f = m[..., 1, 2], m[..., 2, 0], m[..., 0, 1]
    rows = np.stack(
        [
            np.stack([squares[..., 0], c + f, b + e, a - d], -1),
            np.stack([c + f, squares[..., 1], a + d, b - e], -1),
            np.stack([b + e, a + d, squares[..., 2], c - f], -1),
            np.stack([a - d, b - e, c - f, squares[..., 3]], -1),
        ],
        -2,
    )
    pick = np.argmax(squares, axis=-1)
    quat = np.take_along_axis(rows, pick[..., None, None], axis=-2)[..., 0, :]
    quat = quat / np.linalg.norm(quat, axis=-1, keepdims=True)
    return np.asarray(np.where(quat[..., 3:] < 0, -quat, quat))


def rotvec_to_matrix(rotvec: Array) -> Array:
    """Rotations, shape (..., 3, 3), of rotation vectors in radians, shape (..., 3)."""
    v = np.asarray(rotvec, np.float64)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    half = 0.5 * angle
    quat = np.concatenate([0.5 * np.sinc(half / np.pi) * v, np.cos(half)], -1)
    return quat_to_matrix(quat)
