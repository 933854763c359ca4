"""Rotations and quaternions (x, y, z, w), vectorised."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

R_CAMERA_FACING_MODEL: Array = np.diag([1.0, -1.0, -1.0])
"""``R_camera_model`` of an upright person facing a level camera.

The model's y is up and its z forward, out of the chest; the camera's y is down and its z away from it.
"""
R_CAMERA_FACING_MODEL.setflags(write=False)


def quat_to_matrix(quat_xyzw: Array) -> Array:
    """Rotation matrices, shape (..., 3, 3), of unit quaternions, shape (..., 4)."""
    q = np.asarray(quat_xyzw, np.float64)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1 - 2 * (y * y + z * z)
    out[..., 1, 1] = 1 - 2 * (x * x + z * z)
    out[..., 2, 2] = 1 - 2 * (x * x + y * y)
    out[..., 0, 1], out[..., 1, 0] = 2 * (x * y - z * w), 2 * (x * y + z * w)
    out[..., 0, 2], out[..., 2, 0] = 2 * (x * z + y * w), 2 * (x * z - y * w)
    out[..., 1, 2], out[..., 2, 1] = 2 * (y * z - x * w), 2 * (y * z + x * w)
    return out


def matrix_to_quat(matrix: Array) -> Array:
    """Return unit quaternions (x, y, z, w), shape (..., 4), of rotations, shape (..., 3, 3); w >= 0.

    Takes the largest of the four components first, which keeps it accurate at every angle.
    """
    m = np.asarray(matrix, np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    a, b, c = m[..., 2, 1], m[..., 0, 2], m[..., 1, 0]
    d, e, f = m[..., 1, 2], m[..., 2, 0], m[..., 0, 1]
    rows = np.empty((*m.shape[:-2], 4, 4))  # 4 q q', each row a multiple of the quaternion
    rows[..., 0, 0], rows[..., 1, 1] = 1 + xx - yy - zz, 1 - xx + yy - zz
    rows[..., 2, 2], rows[..., 3, 3] = 1 - xx - yy + zz, 1 + xx + yy + zz
    rows[..., 0, 1] = rows[..., 1, 0] = c + f
    rows[..., 0, 2] = rows[..., 2, 0] = b + e
    rows[..., 1, 2] = rows[..., 2, 1] = a + d
    rows[..., 0, 3] = rows[..., 3, 0] = a - d
    rows[..., 1, 3] = rows[..., 3, 1] = b - e
    rows[..., 2, 3] = rows[..., 3, 2] = c - f
    pick = rows.diagonal(axis1=-2, axis2=-1).argmax(axis=-1)
    quat = rows.reshape(-1, 4, 4)[np.arange(pick.size), pick.ravel()].reshape(*pick.shape, 4)
    quat = quat / lengths_of(quat)[..., None]
    return np.asarray(np.where(quat[..., 3:] < 0, -quat, quat))


def slerp(a: Array, b: Array, share: Array) -> Array:
    """Interpolate quaternions (..., 4) along the shortest path, at shares (...) of it.

    K. Shoemake, *Animating rotation with quaternion curves*, SIGGRAPH 1985.
    """
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(cosine < 0, -b, b)
    share = np.broadcast_to(share[..., None], cosine.shape)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.maximum(np.sin(angle), 1e-12)
    close = angle < 1e-6
    mixed = np.where(close, 1 - share, np.sin((1 - share) * angle) / sine) * a
    mixed += np.where(close, share, np.sin(share * angle) / sine) * b
    mixed /= lengths_of(mixed)[..., None]
    return np.asarray(np.where(share == 0, a, np.where(share == 1, b, mixed)))


def rotvec_to_matrix(rotvec: Array) -> Array:
    """Rotations, shape (..., 3, 3), of rotation vectors in radians, shape (..., 3)."""
    v = np.asarray(rotvec, np.float64)
    angle = lengths_of(v)[..., None]
    half = 0.5 * angle
    quat = np.concatenate([0.5 * np.sinc(half / np.pi) * v, np.cos(half)], -1)
    return quat_to_matrix(quat)


def rotation_x(angle: Array) -> Array:
    """Rotations about x by angles in radians, shape (...) to (..., 3, 3)."""
    return _axis_rotation(angle, 1, 2)


def rotation_y(angle: Array) -> Array:
    """Rotations about y by angles in radians, shape (...) to (..., 3, 3)."""
    return _axis_rotation(angle, 2, 0)


def rotation_z(angle: Array) -> Array:
    """Rotations about z by angles in radians, shape (...) to (..., 3, 3)."""
    return _axis_rotation(angle, 0, 1)


def _axis_rotation(angle: Array, i: int, j: int) -> Array:
    angle = np.asarray(angle, dtype=np.float64)
    out = np.zeros((*angle.shape, 3, 3))
    out[..., 3 - i - j, 3 - i - j] = 1.0
    cosine, sine = np.cos(angle), np.sin(angle)
    out[..., i, i] = out[..., j, j] = cosine
    out[..., j, i] = sine
    out[..., i, j] = -sine
    return out


def length_of(vector: Array) -> float:
    """Length of a vector (3,); `np.linalg.norm` takes any array, and longer."""
    return math.sqrt(vector.dot(vector))


def lengths_of(vectors: NDArray[Any]) -> NDArray[Any]:
    """Lengths (...) of vectors (..., N): `np.linalg.norm` along the last axis takes twice as long for few."""
    return np.sqrt(np.add.reduce(vectors * vectors, axis=-1))


def unit_vectors(vectors: Array) -> Array:
    """Directions (..., 3) of vectors, of length 1; vectors shorter than 1e-9 stay short."""
    return np.asarray(vectors / np.maximum(lengths_of(vectors)[..., None], 1e-9))


def rotation_between(source: Array, target: Array) -> Array:
    """Smallest rotations that turn unit vectors into others, (..., 3) to (..., 3, 3)."""
    x, y, z = (source[..., a] for a in range(3))
    u, v, w = (target[..., a] for a in range(3))
    k = cross_matrix(y * w - z * v, z * u - x * w, x * v - y * u)
    cosine = np.asarray(x * u + y * v + z * w)[..., None, None]
    return np.asarray(np.eye(3) + k + (k @ k) / np.maximum(1.0 + cosine, 1e-9))


def cross_matrix(x: Array, y: Array, z: Array) -> Array:
    """Matrices (..., 3, 3) that take the cross product with (x, y, z)."""
    k = np.zeros((*np.shape(x), 3, 3))
    k[..., 0, 1], k[..., 0, 2], k[..., 1, 2] = -z, y, -x
    k[..., 1, 0], k[..., 2, 0], k[..., 2, 1] = z, -y, x
    return k


def mirror_rotation(rotation: Array) -> Array:
    """``S R S`` with ``S = diag(-1, 1, 1)``: rotations seen in a mirror at x = 0, (..., 3, 3)."""
    flip = np.array([-1.0, 1.0, 1.0])
    return np.asarray(np.outer(flip, flip) * rotation)


def nearest_rotation(matrix: Array) -> Array:
    """Rotations nearest to matrices (least squares), (..., 3, 3) to (..., 3, 3)."""
    u, _, vt = np.linalg.svd(matrix)
    u[..., :, 2] *= np.linalg.det(u @ vt)[..., None]
    result: Array = u @ vt
    return result
