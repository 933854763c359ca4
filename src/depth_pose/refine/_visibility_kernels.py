"""Compiled loops that find the visible vertices of a posed body."""

from __future__ import annotations

import numpy as np

from depth_pose.core._camera_kernels import project
from depth_pose.core._raster_kernels import NEAR_M
from depth_pose.core.kernels import njit


@njit(cache=True, fastmath=True, forceinline=True)
def turn_normals(rest_normals, influence, rotations, normals):
    """Rotate each vertex's rest normal with the node that has the most influence on it."""
    for i in range(rest_normals.shape[0]):
        r = rotations[influence[i, 0]]
        for a in range(3):
            normals[i, a] = (
                r[a, 0] * rest_normals[i, 0] + r[a, 1] * rest_normals[i, 1] + r[a, 2] * rest_normals[i, 2]
            )


@njit(cache=True, fastmath=True, forceinline=True)
def mark_visible(vertices, normals, zbuffer, camera, tolerance, visible):
    """Mark the vertices that face the camera and lie at most ``tolerance`` behind the rendered depth."""
    rows, cols = zbuffer.shape
    for i in range(vertices.shape[0]):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        visible[i] = False
        if z < NEAR_M or normals[i, 0] * x + normals[i, 1] * y + normals[i, 2] * z > 0.0:
            continue
        u, v = project(camera, x, y, z)
        a, b = int(np.rint(v)), int(np.rint(u))
        if a < 0 or b < 0 or a >= rows or b >= cols:
            continue
        visible[i] = z <= zbuffer[a, b] + tolerance
