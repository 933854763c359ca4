"""Soft surfaces under a body and cloth over it, as heights above a plane.

A body is drawn along the plane's normal into a grid of heights. A cushion is lowered where the body is below
its surface, a sheet is raised where the body is above; both pass over to the untouched surface with a
slope, because neither foam nor cloth has steps.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter, grey_dilation

from depth_pose.core.camera import Camera
from depth_pose.sim import _scene_kernels as kernels
from depth_pose.sim._meshes import Piece, grid_faces

Array = NDArray[np.float64]

CELL_M = 0.03
"""Width of a grid's cells, metres."""
DEEPEST_M = 0.22
"""Maximum depth of a body in a surface, metres; a deeper one is beside it."""

_FAR_M = 20.0
"""Distance of the drawing camera from the plane, metres: farther than any body reaches."""
_COVERED_M = 0.012
"""A sheet this far above the surface below it covers a person, metres."""


@dataclass(frozen=True)
class Plane:
    """A rectangle of cells that heights are measured from.

    Attributes
    ----------
    origin : (3,) float64
        The first cell's middle, metres.
    axes : (3, 3) float64
        Rows: the direction of the grid's rows, that of its columns, and the normal.
    shape : (int, int)
    """

    origin: Array
    axes: Array
    shape: tuple[int, int]

    def heights(self, vertices: Array, faces: NDArray[np.integer], below: bool = False) -> Array:
        """Return the highest point of a mesh over each cell, or the lowest; NaN where there is none."""
        sign = -1.0 if below else 1.0
        row, column, height = ((vertices - self.origin) @ self.axes.T).T
        z = _FAR_M - sign * height
        rows, columns = self.shape
        camera = Camera(columns, rows, _FAR_M / CELL_M, _FAR_M / CELL_M, 0.0, 0.0)
        # scaled by the distance, the projection of a pinhole is a parallel one
        points = np.stack([column * z / _FAR_M, row * z / _FAR_M, z], axis=1)
        inverse, face = np.zeros(self.shape), np.full(self.shape, -1, np.int32)
        kernels.raster(points, faces.astype(np.int64), camera, 0.1, inverse, face)
        drawn = face >= 0
        return np.where(drawn, sign * (_FAR_M - 1.0 / np.where(drawn, inverse, 1.0)), np.nan)

    def points(self, heights: Array) -> Array:
        """Return the points (rows, columns, 3) at these heights, metres."""
        row, column = (CELL_M * np.arange(n) for n in self.shape)
        return np.asarray(
            self.origin
            + row[:, None, None] * self.axes[0]
            + column[None, :, None] * self.axes[1]
            + heights[..., None] * self.axes[2]
        )


def spread(bump: Array, slope: float) -> Array:
    """Blend bumps (or dents, as positive numbers) into their surroundings with a slope."""
    reach = min(int(np.ceil(float(bump.max(initial=0.0)) / (slope * CELL_M))), 10)
    if reach == 0:
        return bump
    away = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) * CELL_M
    wide = np.maximum(grey_dilation(bump, structure=-slope * away, mode="constant", cval=0.0), 0.0)
    return np.asarray(gaussian_filter(wide, 1.0))


def press(plane: Plane, rest: Array, vertices: Array, faces: NDArray[np.integer], slope: float) -> Array:
    """Return the heights of a soft surface under a body that lies on it; ``rest`` are those without."""
    under = plane.heights(vertices, faces, below=True)
    dent = np.nan_to_num(rest - under)
    return np.asarray(rest - spread(np.where((dent > 0) & (dent < DEEPEST_M), dent, 0.0), slope))


@dataclass(frozen=True)
class Cover:
    """A sheet over a body: points (rows, columns, 3), and the part that covers the body as a mesh."""

    points: Array
    person: Piece


def cover(
    rng: np.random.Generator, plane: Plane, rest: Array, vertices: Array, faces: NDArray[np.integer]
) -> Cover:
    """Lay a sheet over a surface of heights ``rest`` and a body on it."""
    bump = np.maximum(np.nan_to_num(plane.heights(vertices, faces) - rest), 0.0)
    thick = rng.uniform(0.004, 0.035)
    lifted = spread(bump, rng.uniform(0.9, 3.0))
    folds = gaussian_filter(rng.standard_normal(plane.shape), rng.uniform(1.2, 3.0))
    folds *= rng.uniform(0.0, 0.02) / max(float(folds.std()), 1e-9)
    heights = rest + thick + lifted + np.clip(folds, -0.7 * thick, 0.04)
    on = binary_dilation(bump > _COVERED_M) & (lifted > _COVERED_M)
    grid = grid_faces(*plane.shape, False)
    kept = grid[on.ravel()[grid].sum(axis=1) >= 2]
    points = plane.points(heights)
    used, kept = np.unique(kept, return_inverse=True)
    lift = 0.003 * plane.axes[2]  # before the sheet's part that belongs to the bed
    return Cover(points, (points.reshape(-1, 3)[used] + lift, kept.reshape(-1, 3).astype(np.int32)))


def with_sides(points: Array, drop: Array) -> Array:
    """Surround a grid of points (rows, columns, 3) by sides that go down by a vector, metres."""
    padded = np.pad(points, ((1, 1), (1, 1), (0, 0)), mode="edge")
    for edge in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
        padded[edge] = padded[edge] + drop
    return padded
