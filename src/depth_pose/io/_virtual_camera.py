"""A virtual pinhole camera for clouds without one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera

_POINTS_PER_PIXEL = 1.6
"""Mean number of points per pixel in occupied areas, so that few pixels stay empty; set by hand."""

MAX_TANGENT = 1.75
"""Maximum x/z and y/z: 120 degrees field of view; set by hand."""

_LEAST_SIDE, _MOST_SIDE = 32, 640
"""Limits of the longer side (pixels); the maximum is that of current sensors; set by hand."""

_COARSE_CELLS = 48
"""Number of cells along the longer side for estimating the occupied area; set by hand."""

_SURFACE_JUMP_M = 0.1
"""Depth difference (m) above which neighbours of a hole belong to two surfaces; set by hand."""


def project_cloud(points: NDArray[np.floating]) -> tuple[NDArray[np.float32], Camera]:
    """Render points into a virtual camera at the origin, nearest first.

    Parameters
    ----------
    points : (n, 3) float
        Finite points with z > 0, metres, optical frame; at least one.

    Returns
    -------
    depth : (H, W) float32
        Metres; 0 without a point. Single empty pixels inside a surface are filled.
    camera : Camera
    """
    x, y, z = points.astype(np.float64).T
    a, b = x / z, y / z
    ahead = (np.abs(a) < MAX_TANGENT) & (np.abs(b) < MAX_TANGENT)
    if not ahead.any():
        ahead[:] = True
    a, b, z = a[ahead], b[ahead], z[ahead]
    camera = _fit_camera(a, b)
    column = np.rint(camera.fx * a + camera.cx).astype(np.int64).clip(0, camera.width - 1)
    row = np.rint(camera.fy * b + camera.cy).astype(np.int64).clip(0, camera.height - 1)
    nearest = np.full(camera.height * camera.width, np.inf)
    np.minimum.at(nearest, row * camera.width + column, z)
    depth = np.where(np.isfinite(nearest), nearest, 0.0).reshape(camera.height, camera.width)
    return _fill_single_holes(depth).astype(np.float32), camera


def _fit_camera(a: NDArray[np.float64], b: NDArray[np.float64]) -> Camera:
    """Choose the camera whose occupied pixels hold about `_POINTS_PER_PIXEL` points."""
    low = np.array([a.min(), b.min()])
    extent = np.maximum(np.array([a.max(), b.max()]) - low, 1e-3)
    cell = extent.max() / _COARSE_CELLS
    cells = np.stack([(a - low[0]) / cell, (b - low[1]) / cell]).astype(np.int64)
    occupied = len(np.unique(cells[0] * (_COARSE_CELLS + 2) + cells[1])) * cell * cell
    focal = np.sqrt(a.size / (_POINTS_PER_PIXEL * occupied))
    focal = float(np.clip(focal, _LEAST_SIDE / extent.max(), _MOST_SIDE / extent.max()))
    width, height = (np.ceil(extent * focal).astype(int) + 3).tolist()
    cx, cy = (1.0 - low * focal).tolist()
    return Camera(width=width, height=height, fx=focal, fy=focal, cx=cx, cy=cy)


def _fill_single_holes(depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fill empty pixels with the median of their neighbours where five or more agree."""
    height, width = depth.shape
    padded = np.pad(depth, 1)
    around = np.stack(
        [
            padded[dy : dy + height, dx : dx + width]
            for dy in range(3)
            for dx in range(3)
            if (dy, dx) != (1, 1)
        ]
    )
    filled = np.where(around > 0, around, np.nan)
    known = (around > 0).sum(axis=0)
    hole = (depth == 0) & (known >= 5)
    if hole.any():
        at_hole = filled[:, hole]
        agree = np.nanmax(at_hole, axis=0) - np.nanmin(at_hole, axis=0) < _SURFACE_JUMP_M
        depth = depth.copy()
        depth[hole] = np.where(agree, np.nanmedian(at_hole, axis=0), 0.0)
    return depth
