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
def compare(zbuffer, depth, labels, band, out):
    """Rendered-depth score: mean of min(|dz|, band) / band over the union of the silhouettes.

    A pixel in only one silhouette counts 1; pixels where nothing is known are left out. Writes
    to ``out``: the score; over the overlap, the mean |dz| cut at the band and the mean dz cut at
    three bands; and the silhouettes' difference in mean column and row, observed less drawn.
    """
    total, count, gap, signed, overlap = 0.0, 0, 0.0, 0.0, 0
    drawn_j, drawn_i, drawn_count, seen_j, seen_i, seen_count = 0.0, 0.0, 0, 0.0, 0.0, 0
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            label = labels[i, j]
            drawn = zbuffer[i, j] < np.inf
            if label == 2:
                continue
            if drawn:
                drawn_i += i
                drawn_j += j
                drawn_count += 1
            if label == 1:
                seen_i += i
                seen_j += j
                seen_count += 1
                count += 1
                if drawn:
                    dz = depth[i, j] - zbuffer[i, j]
                    signed += min(max(dz, -3.0 * band), 3.0 * band)
                    cut = min(abs(dz), band)
                    total += cut / band
                    gap += cut
                    overlap += 1
                else:
                    total += 1.0
            elif drawn:
                count += 1
                total += 1.0
    out[0] = total / max(count, 1)
    out[1] = gap / max(overlap, 1)
    out[2] = signed / max(overlap, 1)
    out[3] = out[4] = 0.0
    if drawn_count > 0 and seen_count > 0:
        out[3] = seen_j / seen_count - drawn_j / drawn_count
        out[4] = seen_i / seen_count - drawn_i / drawn_count
