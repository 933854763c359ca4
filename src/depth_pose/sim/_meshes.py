"""Small meshes of clothes and objects, and their combination."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
Piece = tuple[Array, Faces]
"""Vertices (V, 3), metres, and faces (F, 3)."""

SMALLEST_AREA_M2 = 1e-9
"""Triangles smaller than this are left out."""


def empty() -> Piece:
    """Return an empty mesh."""
    return np.zeros((0, 3)), np.zeros((0, 3), np.int32)


def join(pieces: Sequence[Piece]) -> Piece:
    """Combine meshes and drop triangles without area."""
    if not pieces:
        return empty()
    first = np.cumsum([0] + [len(v) for v, _ in pieces[:-1]])
    vertices = np.concatenate([v for v, _ in pieces])
    faces = np.concatenate([f + n for (_, f), n in zip(pieces, first, strict=True)])
    normals = face_normals(vertices, faces)
    area = 0.5 * np.sqrt(np.einsum("ij,ij->i", normals, normals))
    return vertices, faces[area > SMALLEST_AREA_M2].astype(np.int32)


def face_normals(vertices: Array, faces: Faces) -> Array:
    """Outward normals (F, 3) as long as twice the triangles' areas."""
    a = vertices[faces[:, 0]]
    u, v = vertices[faces[:, 1]] - a, vertices[faces[:, 2]] - a
    out = np.empty_like(u)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i] = u[:, j] * v[:, k] - u[:, k] * v[:, j]
    return out


def loft(rings: Array, closed: bool = True) -> Piece:
    """Join rows of points to a sheet, or to a tube when rows close on themselves.

    Parameters
    ----------
    rings : (R, C, 3)
        Metres.
    closed : bool
        Whether the last column joins the first.
    """
    rows, columns = rings.shape[:2]
    return rings.reshape(-1, 3), grid_faces(rows, columns, closed)


@lru_cache(maxsize=64)
def grid_faces(rows: int, columns: int, closed: bool) -> Faces:
    """Triangles of a grid of points, row by row; where closed, the last column joins the first."""
    at = np.arange(rows * columns).reshape(rows, columns)
    right = np.roll(at, -1, axis=1) if closed else at[:, 1:]
    here = at if closed else at[:, :-1]
    a, b, c, d = (x.ravel() for x in (here[:-1], right[:-1], here[1:], right[1:]))
    return np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]).astype(np.int32)


@lru_cache(maxsize=1)
def _ball() -> Piece:
    """Make a unit sphere of rows and columns with two poles."""
    rows, columns = 9, 14
    polar = np.pi * np.arange(1, rows) / rows
    round_ = 2 * np.pi * np.arange(columns) / columns
    ring = np.stack(
        [
            np.sin(polar)[:, None] * np.sin(round_),
            np.cos(polar)[:, None] + 0 * round_,
            np.sin(polar)[:, None] * np.cos(round_),
        ],
        axis=-1,
    )
    vertices, faces = loft(ring)
    top, bottom, last = len(vertices), len(vertices) + 1, (rows - 2) * columns
    at, after = np.arange(columns), np.roll(np.arange(columns), -1)
    caps = np.concatenate(
        [
            np.stack([np.full(columns, top), at, after], 1),
            np.stack([np.full(columns, bottom), last + after, last + at], 1),
        ]
    )
    vertices = np.concatenate([vertices, [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    return vertices, np.concatenate([faces, caps]).astype(np.int32)


def blob(half: Array, squareness: float = 0.0) -> Piece:
    """Make an ellipsoid about the origin, or a box with round edges.

    Parameters
    ----------
    half : (3,)
        Half-axes, metres.
    squareness : float
        0 for an ellipsoid, toward 1 for a box (a superellipsoid, A. Barr, *Superquadrics and
        angle-preserving transformations*, IEEE CG&A 1, 1981).
    """
    vertices, faces = _ball()
    if squareness:
        vertices = np.sign(vertices) * np.abs(vertices) ** (1.0 - squareness)
    return vertices * half, faces


def box(half: Array) -> Piece:
    """Make a box about the origin, half-axes in metres."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return corners * half, np.array(faces, np.int32)


def moved(piece: Piece, rotation: Array, origin: Array) -> Piece:
    """Rotate and translate a mesh."""
    return piece[0] @ rotation.T + origin, piece[1]


def frame(forward: Array, up: Array) -> Array:
    """Return the rotation (3, 3) with z forward and y as far up as possible."""
    z = forward / max(float(np.linalg.norm(forward)), 1e-9)
    x = np.cross(up, z)
    if np.linalg.norm(x) < 1e-6:
        x = np.cross([0.0, 0.31, 0.95], z)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def smooth_noise(rng: np.random.Generator, points: Array, wave_m: tuple[float, float], waves: int) -> Array:
    """Smooth random field at points, within about -1 to 1.

    Parameters
    ----------
    rng : numpy.random.Generator
    points : (N, 3)
        Metres.
    wave_m : (float, float)
        Shortest and longest wavelength, metres.
    waves : int
        Sinusoids that are added.

    Returns
    -------
    (N,) float64
    """
    direction = rng.normal(size=(3, waves))
    direction *= 2 * np.pi / rng.uniform(*wave_m, waves) / np.linalg.norm(direction, axis=0)
    # Single precision: its sine is several times as fast, and noise needs no more.
    phases = points.astype(np.float32) @ direction.astype(np.float32)
    phases += rng.uniform(0, 2 * np.pi, waves).astype(np.float32)
    return np.asarray(np.sin(phases).sum(axis=1) / np.sqrt(2.0 * waves), np.float64)
