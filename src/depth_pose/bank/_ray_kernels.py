"""Compiled loops that aim rays at a body and gather what they hit; `depth_pose.bank.views` uses them."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True)
def grid_around(vertices, rotation, target, distance, spacing):
    """Lowest tangents and size of the grid of rays that covers a body: x, y, columns, rows."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(vertices.shape[0]):
        dx, dy, dz = vertices[i, 0] - target[0], vertices[i, 1] - target[1], vertices[i, 2] - target[2]
        z = rotation[2, 0] * dx + rotation[2, 1] * dy + rotation[2, 2] * dz + distance
        x = (rotation[0, 0] * dx + rotation[0, 1] * dy + rotation[0, 2] * dz) / z
        y = (rotation[1, 0] * dx + rotation[1, 1] * dy + rotation[1, 2] * dz) / z
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
    columns = int(np.floor((high_x - low_x) / spacing)) + 2
    rows = int(np.floor((high_y - low_y) / spacing)) + 2
    return low_x, low_y, columns, rows


@njit(cache=True)
def aim_rays(low_x, low_y, columns, rows, spacing, rotation, eye, rays):
    """Write a grid's rays in the model frame, (rows * columns, 6); one unit along each is one of depth."""
    k = 0
    for i in range(rows):
        y = low_y + i * spacing
        for j in range(columns):
            x = low_x + j * spacing
            for a in range(3):
                rays[k, a] = eye[a]
                rays[k, 3 + a] = x * rotation[0, a] + y * rotation[1, a] + rotation[2, a]
            k += 1


@njit(cache=True)
def gather_hits(low_x, low_y, columns, rows, spacing, depth):
    """Points hit, in the camera frame, (P, 3)."""
    count = 0
    for k in range(rows * columns):
        count += np.isfinite(depth[k])
    points = np.empty((count, 3))
    n = 0
    for i in range(rows):
        for j in range(columns):
            z = float(depth[i * columns + j])
            if np.isfinite(z):
                points[n, 0] = (low_x + j * spacing) * z
                points[n, 1] = (low_y + i * spacing) * z
                points[n, 2] = z
                n += 1
    return points
