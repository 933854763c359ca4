"""Compiled z-buffer; `depth_pose.render` says what it is for."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True)
def rasterize(vertices, faces, fx, fy, cx, cy, zbuffer):
    """Draw a mesh in the camera frame into ``zbuffer``, which is cleared to infinity first."""
    rows, cols = zbuffer.shape
    zbuffer[:] = np.inf
    n = vertices.shape[0]
    u = np.empty(n)
    v = np.empty(n)
    w = np.empty(n)
    for i in range(n):
        z = vertices[i, 2]
        w[i] = 1.0 / z if z > 0.05 else 0.0
        u[i] = fx * vertices[i, 0] * w[i] + cx
        v[i] = fy * vertices[i, 1] * w[i] + cy
    for k in range(faces.shape[0]):
        a, b, c = faces[k, 0], faces[k, 1], faces[k, 2]
        if w[a] == 0.0 or w[b] == 0.0 or w[c] == 0.0:
            continue
        area = (u[b] - u[a]) * (v[c] - v[a]) - (u[c] - u[a]) * (v[b] - v[a])
        if area >= 0.0:  # seen from behind: y points down, outward faces turn clockwise
            continue
        low_j = max(0, int(np.ceil(min(u[a], u[b], u[c]))))
        high_j = min(cols - 1, int(np.floor(max(u[a], u[b], u[c]))))
        low_i = max(0, int(np.ceil(min(v[a], v[b], v[c]))))
        high_i = min(rows - 1, int(np.floor(max(v[a], v[b], v[c]))))
        if low_j > high_j or low_i > high_i:
            continue
        # barycentric weights and inverse depth are linear in the image
        inverse = 1.0 / area
        for i in range(low_i, high_i + 1):
            for j in range(low_j, high_j + 1):
                s = ((u[b] - j) * (v[c] - i) - (u[c] - j) * (v[b] - i)) * inverse
                t = ((u[c] - j) * (v[a] - i) - (u[a] - j) * (v[c] - i)) * inverse
                r = 1.0 - s - t
                if s < 0.0 or t < 0.0 or r < 0.0:
                    continue
                z = 1.0 / (s * w[a] + t * w[b] + r * w[c])
                if z < zbuffer[i, j]:
                    zbuffer[i, j] = z


@njit(cache=True)
def compare(zbuffer, depth, labels, band):
    """Rendered-depth score: mean of min(|dz|, band) / band over the union of the silhouettes.

    A pixel in only one silhouette counts 1. Returns the score, and over the overlap the mean of
    clipped |dz| in metres.
    """
    total, count, gap, overlap = 0.0, 0, 0.0, 0
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            label = labels[i, j]
            drawn = zbuffer[i, j] < np.inf
            if label == 1:
                count += 1
                if drawn:
                    dz = min(abs(zbuffer[i, j] - depth[i, j]), band)
                    total += dz / band
                    gap += dz
                    overlap += 1
                else:
                    total += 1.0
            elif label == 0 and drawn:
                count += 1
                total += 1.0
    return total / max(count, 1), gap / max(overlap, 1)
