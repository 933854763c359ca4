"""Compiled loops over points in canonical axes."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True)
def weighted_moments(points):
    """Centroid and covariance with weight z^2: each pixel counts the area that it covers."""
    total = 0.0
    mean = np.zeros(3)
    second = np.zeros((3, 3))
    for i in range(points.shape[0]):
        w = points[i, 2] * points[i, 2]
        total += w
        for a in range(3):
            mean[a] += w * points[i, a]
            for b in range(a + 1):
                second[a, b] += w * points[i, a] * points[i, b]
    mean /= total
    for a in range(3):
        for b in range(a + 1):
            second[a, b] = second[a, b] / total - mean[a] * mean[b]
            second[b, a] = second[a, b]
    return mean, second


@njit(cache=True)
def splat(points, rotation, origin, scale, half_width, depth_limit, level, image):
    """Draw points in canonical axes: the mean of ``level - depth`` of each cell's points.

    ``rotation`` has the canonical axes (right, up, toward the camera) as rows.
    """
    size = image.shape[0]
    count = np.zeros((size, size), np.int32)
    image[:] = 0.0
    for i in range(points.shape[0]):
        dx, dy, dz = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        x = (rotation[0, 0] * dx + rotation[0, 1] * dy + rotation[0, 2] * dz) / scale
        y = (rotation[1, 0] * dx + rotation[1, 1] * dy + rotation[1, 2] * dz) / scale
        z = (rotation[2, 0] * dx + rotation[2, 1] * dy + rotation[2, 2] * dz) / scale
        a = int(np.floor((half_width - y) / (2.0 * half_width) * size))
        b = int(np.floor((half_width + x) / (2.0 * half_width) * size))
        if a < 0 or b < 0 or a >= size or b >= size:
            continue
        image[a, b] += level + min(max(z, -depth_limit), depth_limit)
        count[a, b] += 1
    for a in range(size):
        for b in range(size):
            if count[a, b] > 1:
                image[a, b] /= count[a, b]
