"""Rotation matrices for kernels."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True)
def matrix_of(quat, out):
    """Rotation matrix of a quaternion x, y, z, w, normalised first."""
    x, y, z, w = float(quat[0]), float(quat[1]), float(quat[2]), float(quat[3])
    s = 2.0 / (x * x + y * y + z * z + w * w)
    out[0, 0], out[0, 1], out[0, 2] = 1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)
    out[1, 0], out[1, 1], out[1, 2] = s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)
    out[2, 0], out[2, 1], out[2, 2] = s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)


@njit(cache=True)
def rotation_of(w, out):
    """Rotation matrix of a rotation vector, radians: Rodrigues' formula."""
    angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    angle = np.sqrt(angle2)
    if angle < 1e-8:
        a, b = 1.0, 0.5
    else:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    x, y, z = w[0], w[1], w[2]
    out[0, 0], out[0, 1], out[0, 2] = 1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    out[1, 0], out[1, 1], out[1, 2] = b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x
    out[2, 0], out[2, 1], out[2, 2] = b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)


@njit(cache=True)
def rotation_between(a, b, out):
    """Smallest rotation that turns a unit vector into another."""
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    s = 1.0 / max(1.0 + cosine, 1e-9)
    out[0, 0], out[0, 1], out[0, 2] = 1 - s * (y * y + z * z), s * x * y - z, s * x * z + y
    out[1, 0], out[1, 1], out[1, 2] = s * x * y + z, 1 - s * (x * x + z * z), s * y * z - x
    out[2, 0], out[2, 1], out[2, 2] = s * x * z - y, s * y * z + x, 1 - s * (x * x + y * y)


@njit(cache=True)
def multiply(a, b, out):
    """Product of two 3 x 3 matrices; ``out`` is neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
