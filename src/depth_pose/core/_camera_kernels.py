"""Projection and back-projection for kernels; a camera is a `depth_pose.core.camera.Camera`."""

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True, inline="always")
def project(camera, x, y, z):
    """Column and row of one point, for kernels."""
    return camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy


@njit(cache=True, inline="always")
def ray(camera, column, row):
    """Return x and y of a pixel's ray at z = 1, for kernels."""
    return (column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy


@njit(cache=True)
def back_project(depth, camera):
    """Points of a depth image (H, W, 3) float32, NaN where there is none."""
    rows, cols = depth.shape
    points = np.empty((rows, cols, 3), np.float32)
    for i in range(rows):
        for j in range(cols):
            z = depth[i, j]
            if z > 0.0:
                x, y = ray(camera, j, i)
                points[i, j, 0], points[i, j, 1], points[i, j, 2] = x * z, y * z, z
            else:
                points[i, j, :] = np.nan
    return points
