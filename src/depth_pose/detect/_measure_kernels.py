"""Compiled loops that measure clusters of votes, for `depth_pose.detect.verifier`.

``image`` is a `NetImage`.
"""

from __future__ import annotations

import numpy as np

from depth_pose.core._camera_kernels import ray
from depth_pose.core._odds_kernels import logistic
from depth_pose.core.kernels import njit

_SAME_M = 0.1
"""Pixels of two grids that differ by less in depth (m) show the same surface."""

MEASURES = 20
"""Number of measures of a cluster, by `measure_clusters` and `measure_neighbours`."""

_ALONE_M = 2.0
"""Distance (m) assigned to a cluster without a neighbour."""


@njit(cache=True)
def distance2(a, b):
    """Compute the squared distance of two points."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@njit(cache=True)
def measure_clusters(image, mask, torso, votes, owner, modes, out):
    """Compute the measures that distinguish people from objects; see the lines below.

    Writes ``out`` (P, MEASURES), except the last ones, which `measure_neighbours` writes.
    """
    grid, rows, cols, camera = image.depth, image.rows, image.cols, image.camera
    flat, points, areas = votes.flat, votes.points, votes.areas
    count = modes.shape[0]
    out[:] = 0.0
    pixels = np.zeros(count)
    area = np.zeros(count)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    moment, mean = np.zeros((count, 3, 3)), np.zeros((count, 3))
    edge, jump = np.zeros(count), np.zeros(count)
    for k in range(flat.shape[0]):
        p = owner[k] - 1
        if p < 0:
            continue
        i, j = flat[k] // grid.shape[1], flat[k] % grid.shape[1]
        z = grid[i, j]
        x, y = ray(camera, j, i)
        q = (np.float64(x * z), np.float64(y * z), np.float64(z))
        prob = logistic(mask[i, j])
        pixels[p] += 1.0
        area[p] += areas[k]
        out[p, 0] += prob
        out[p, 1] += prob > 0.8
        out[p, 2] = max(out[p, 2], prob)
        out[p, 3] += distance2(points[k], modes[p])
        out[p, 4] += torso[3, i, j]
        out[p, 5] += i == 0 or j == 0 or i == rows - 1 or j == cols - 1
        for a in range(3):
            low[p, a], high[p, a] = min(low[p, a], q[a]), max(high[p, a], q[a])
            mean[p, a] += q[a]
            for b in range(3):
                moment[p, a, b] += q[a] * q[b]
        for d in range(4):  # at the cluster's edge: does the depth jump, or does the surface continue?
            a = i + (1 if d == 0 else -1 if d == 1 else 0)
            b = j + (1 if d == 2 else -1 if d == 3 else 0)
            if a < 0 or b < 0 or a >= rows or b >= cols or grid[a, b] <= 0.0 or mask[a, b] > 0.0:
                continue
            edge[p] += 1.0
            jump[p] += abs(grid[a, b] - z) > 0.1
    for p in range(count):
        n = max(pixels[p], 1.0)
        out[p, 0] /= n
        out[p, 1] /= n
        out[p, 3] = np.sqrt(out[p, 3] / n)
        out[p, 4] /= n
        out[p, 5] /= n
        out[p, 6] = np.log(area[p] + 1e-4)
        out[p, 7] = np.log(n)
        out[p, 8] = modes[p, 2]
        for a in range(3):
            out[p, 9 + a] = high[p, a] - low[p, a] if pixels[p] > 0 else 0.0
            mean[p, a] /= n
        out[p, 12] = (jump[p] + 1.0) / (edge[p] + 2.0)
        out[p, 13] = np.log1p(edge[p] / np.sqrt(n))
        cover = moment[p] / n
        for a in range(3):
            for b in range(3):
                cover[a, b] -= mean[p, a] * mean[p, b]
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(cover), 0.0))
        out[p, 14], out[p, 15] = spread[0], spread[1]


@njit(cache=True)
def measure_neighbours(image, labels, modes, out, neighbour):
    """Compute the measures, from 16 on, of each cluster relative to the nearest larger one.

    A part of a person with wrong votes touches the rest and is small. ``neighbour`` (P,) becomes that other
    cluster, -1 for none within `_ALONE_M`.
    """
    grid, rows, cols = image.depth, image.rows, image.cols
    count = modes.shape[0]
    contact = np.zeros((count + 1, count + 1))
    for i in range(rows):
        for j in range(cols):
            a = labels[i, j]
            if a == 0:
                continue
            for d in range(2):
                u, v = (i + 1, j) if d == 0 else (i, j + 1)
                if u >= rows or v >= cols or labels[u, v] == a or labels[u, v] == 0:
                    continue
                if abs(grid[u, v] - grid[i, j]) < _SAME_M:
                    contact[a, labels[u, v]] += 1.0
                    contact[labels[u, v], a] += 1.0
    for p in range(count):
        best, neighbour[p] = _ALONE_M, -1
        for q in range(count):
            away = np.sqrt(distance2(modes[p], modes[q]))
            if q != p and away < best and (out[q, 6] > out[p, 6] or (out[q, 6] == out[p, 6] and q < p)):
                best, neighbour[p] = away, q
        out[p, 16], out[p, 17], out[p, 18], out[p, 19] = _ALONE_M, _ALONE_M, 0.0, 0.0
        q = neighbour[p]
        if q >= 0:
            out[p, 16] = best
            out[p, 17] = np.hypot(modes[p, 0] - modes[q, 0], modes[p, 1] - modes[q, 1])
            out[p, 18] = contact[p + 1, q + 1] / np.exp(0.5 * out[p, 7])
            out[p, 19] = out[q, 6] - out[p, 6]
