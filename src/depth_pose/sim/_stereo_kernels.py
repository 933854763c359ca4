"""Compiled loops of a stereo camera's driver: smoothing that stops at edges, and filling of holes."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit


@njit(cache=True)
def smooth_rows(image, alpha, delta):
    """Smooth along rows, to the right and back, across steps below ``delta``; 0 is a hole, and stops it.

    A recursive filter: what is kept of a pixel is ``alpha``, the rest comes from its neighbour.
    """
    height, width = image.shape
    for i in range(height):
        before = np.float32(0.0)
        for j in range(width):
            z = image[i, j]
            if z > 0.0 and before > 0.0 and abs(z - before) < delta:
                image[i, j] = alpha * z + (np.float32(1.0) - alpha) * before
            before = image[i, j]
        before = np.float32(0.0)
        for k in range(width):
            j = width - 1 - k
            z = image[i, j]
            if z > 0.0 and before > 0.0 and abs(z - before) < delta:
                image[i, j] = alpha * z + (np.float32(1.0) - alpha) * before
            before = image[i, j]


@njit(cache=True)
def fill_holes(disparity, mode, longest):
    """Fill runs of at most ``longest`` zeros in a row: 1 from the left, 2 the farther, 3 the nearer side."""
    height, width = disparity.shape
    for i in range(height):
        j = 0
        while j < width:
            if disparity[i, j] > 0.0:
                j += 1
                continue
            end = j
            while end < width and disparity[i, end] <= 0.0:
                end += 1
            left = disparity[i, j - 1] if j > 0 else np.float32(0.0)
            right = disparity[i, end] if end < width else np.float32(0.0)
            if end - j <= longest:
                value = left
                if mode == 2 and right > 0.0 and (right < left or left <= 0.0):
                    value = right
                if mode == 3 and right > left:
                    value = right
                for k in range(j, end):
                    disparity[i, k] = value
            j = end
