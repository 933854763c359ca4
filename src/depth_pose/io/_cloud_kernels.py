"""Compiled sums over an organised cloud, for `depth_pose.io.clouds`."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True)
def pinhole_sums(points, lines, ends):
    """Compute the sums for linear fits of pixel against ratio, for columns (x/z) and for rows (y/z).

    Writes ``lines`` (2, 5): sums of ratio, pixel, ratio^2, ratio * pixel, pixel^2, with pixels counted from
    the image centre; and ``ends`` (2, 2): the least and the greatest pixel. Returns the number of points in
    front of the camera.
    """
    rows, columns = points.shape[:2]
    count = 0
    lines[:] = 0.0
    ends[:, 0], ends[:, 1] = max(rows, columns), -1
    for i in range(rows):
        v = i - 0.5 * rows
        for j in range(columns):
            z = np.float64(points[i, j, 2])
            if not z > 0.0:
                continue
            u = j - 0.5 * columns
            x, y = points[i, j, 0] / z, points[i, j, 1] / z
            lines[0, 0] += x
            lines[0, 1] += u
            lines[0, 2] += x * x
            lines[0, 3] += x * u
            lines[0, 4] += u * u
            lines[1, 0] += y
            lines[1, 1] += v
            lines[1, 2] += y * y
            lines[1, 3] += y * v
            lines[1, 4] += v * v
            ends[0, 0], ends[0, 1] = min(ends[0, 0], j), max(ends[0, 1], j)
            ends[1, 0], ends[1, 1] = min(ends[1, 0], i), max(ends[1, 1], i)
            count += 1
    return count
