"""Compiled loops that relate a posed body to an image: which vertices it shows, which pixel is nearest."""

from __future__ import annotations

import numpy as np

from depth_pose.core._camera_kernels import project
from depth_pose.core._raster_kernels import NEAR_M
from depth_pose.core.kernels import njit


@njit(cache=True, fastmath=True, forceinline=True)
def turn_normals(rest_normals, influence, rotations, normals):
    """Turn each vertex's rest normal with the node that moves it most."""
    for i in range(rest_normals.shape[0]):
        r = rotations[influence[i, 0]]
        for a in range(3):
            normals[i, a] = (
                r[a, 0] * rest_normals[i, 0] + r[a, 1] * rest_normals[i, 1] + r[a, 2] * rest_normals[i, 2]
            )


@njit(cache=True, fastmath=True, forceinline=True)
def mark_visible(vertices, normals, zbuffer, camera, tolerance, visible):
    """Which vertices face the camera and lie at most ``tolerance`` behind the rendered depth."""
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


@njit(cache=True)
def nearest_person(labels, nearest):
    """Row and column of (nearly) the nearest person pixel to every pixel, by two sweeps."""
    rows, cols = labels.shape
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] == 1:
                nearest[i, j, 0], nearest[i, j, 1] = i, j
            else:
                nearest[i, j, 0], nearest[i, j, 1] = -10000, -10000
    for sweep in range(2):
        for ii in range(rows):
            i = ii if sweep == 0 else rows - 1 - ii
            back = -1 if sweep == 0 else 1
            for jj in range(cols):
                j = jj if sweep == 0 else cols - 1 - jj
                _relax(nearest, i, j, i + back, j)
                _relax(nearest, i, j, i, j + back)
                _relax(nearest, i, j, i + back, j + back)
                _relax(nearest, i, j, i + back, j - back)


@njit(cache=True)
def _relax(nearest, i, j, a, b):
    if a < 0 or b < 0 or a >= nearest.shape[0] or b >= nearest.shape[1]:
        return
    p, q = nearest[a, b, 0], nearest[a, b, 1]
    r, s = nearest[i, j, 0], nearest[i, j, 1]
    if (p - i) ** 2 + (q - j) ** 2 < (r - i) ** 2 + (s - j) ** 2:
        nearest[i, j, 0], nearest[i, j, 1] = p, q
