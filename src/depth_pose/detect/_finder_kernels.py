"""Compiled loops of the people finder, for `depth_pose.detect.finder`.

``image`` is a `NetImage`; ``grid`` is always its depth.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core._camera_kernels import ray
from depth_pose.core.camera import Camera
from depth_pose.core.kernels import njit

ROWS, COLS = 120, 160
"""Size (H, W) of the net's image in training and for usual views, pixels."""

CHANNELS = 12
"""Number of features per pixel; `fill_features` lists them."""

_NARROW_M, _WIDE_M = 0.12, 0.5
"""Half sides of the windows for relative depth (m): a limb, and a body."""

_LOG_STEPS = 256
"""Entries per metre of the logarithm table, which takes a tenth of the time with errors below .004."""

_LOG_TABLE = np.log((np.arange(16 * _LOG_STEPS) + 0.5) / _LOG_STEPS).astype(np.float32)
"""Logarithms of depths up to 16 m, at the middle of each step."""

_CAME_M = 0.25
"""Depth (m) by which something is in front of the background, for one unit of that feature."""

_SAME = 0.5
"""Subtracted from that feature where the background is known, so that 0 means that it is not."""

_RISE_M = 0.04
"""Depth difference per metre of distance below which a pixel's samples are averaged as one surface."""


class NetImage(NamedTuple):
    """A frame on the net's grid.

    Attributes
    ----------
    depth : (H, W) float32
        Metres; 0 without depth, and beyond ``rows`` and ``cols``.
    rows, cols : int
        Part filled by the camera, from the top left.
    stride : float
        Frame pixels per grid pixel.
    camera : Camera
        Camera of that part.
    """

    depth: NDArray[np.float32]
    rows: int
    cols: int
    stride: float
    camera: Camera


@njit(cache=True)
def reduce_grid(depth, stride, rows, cols, near, far, grid):
    """Sample a depth image (metres) to the net's grid with four samples per pixel.

    Pixel (i, j) of the grid covers ``stride`` x ``stride`` pixels from ``(i stride, j stride)``; ``stride``
    need not be an integer. A pixel with fewer than two samples is a hole (0).
    """
    grid[:] = 0.0
    height, width = depth.shape
    left_of, right_of = np.empty(cols, np.int64), np.empty(cols, np.int64)
    for j in range(cols):
        left_of[j] = min(width - 1, int((j + 0.25) * stride))
        right_of[j] = min(width - 1, int((j + 0.75) * stride))
    for i in range(rows):
        a = min(height - 1, int((i + 0.25) * stride))
        b = min(height - 1, int((i + 0.75) * stride))
        for j in range(cols):
            grid[i, j] = near_second(
                depth[a, left_of[j]],
                depth[a, right_of[j]],
                depth[b, left_of[j]],
                depth[b, right_of[j]],
                near,
                far,
            )


@njit(cache=True)
def near_second(a, b, c, d, near, far):
    """Compute the mean of the samples near the second smallest valid one; 0 for fewer than two valid."""
    low, high, low2, high2 = min(a, b), max(a, b), min(c, d), max(c, d)
    least, most = min(low, low2), max(high, high2)
    middle = min(max(low, low2), min(high, high2))
    total = a + b + c + d  # NaN if any is: `min` and `max` may miss it
    if total == total and least >= near and most <= far and most - least <= np.float32(_RISE_M) * middle:
        return total / np.float32(4.0)  # the common case: all four valid, and one surface
    count, total = 0, np.float32(0.0)
    least, second, most = np.float32(np.inf), np.float32(np.inf), np.float32(0.0)
    for z in (a, b, c, d):
        if z >= near and z <= far:
            count += 1
            total += z
            most = max(most, z)
            if z < least:
                least, second = z, least
            elif z < second:
                second = z
    if count < 2:
        return np.float32(0.0)
    reach = np.float32(_RISE_M) * second
    if most - least <= reach:
        return total / np.float32(count)
    count, total = 0, np.float32(0.0)
    for z in (a, b, c, d):
        if z >= near and abs(z - second) <= reach:
            count += 1
            total += z
    return total / np.float32(count)


@njit(cache=True)
def fill_features(image, background, sums, counts, out):
    """Compute the features of every grid pixel for the net.

    0 inverse depth (1/m); 1, 2 depth minus its mean in a window of a limb's and of a body's size, at this
    distance; 3 whether there is a depth; 4 logarithm of the pixel's size here; 5, 6 slopes of the ray; 7, 8
    slopes of the surface; 9 height below the camera's axis; 10 inverse depth of a background that is gone;
    11 depth in front of a known background. All are 0 in holes, except 5, 6 and 10. ``background``
    (H, W) is `StillBackground.depth`; ``sums`` and ``counts`` (H + 1, W + 1) are work space.
    """
    grid, rows, cols, camera = image.depth, image.rows, image.cols, image.camera
    out[:] = 0.0
    for i in range(rows):
        row, seen = 0.0, 0
        for j in range(cols):
            z = grid[i, j]
            row += z
            seen += z > 0.0
            sums[i + 1, j + 1] = sums[i, j + 1] + row
            counts[i + 1, j + 1] = counts[i, j + 1] + seen
    focal, log_focal = np.float32(camera.fx), np.float32(4.0 - np.log(camera.fx))
    half, one = np.float32(0.5), np.float32(1.0)
    narrow, wide = np.float32(_NARROW_M), np.float32(_WIDE_M)
    for i in range(rows):
        slope_y = np.float32(ray(camera, 0, i)[1])
        for j in range(cols):
            out[5, i, j] = slope_y
            out[6, i, j] = np.float32(ray(camera, j, i)[0])
            z, behind = grid[i, j], background[i, j]
            if z <= np.float32(0.0):
                if behind > np.float32(0.0):
                    out[10, i, j] = min(one / behind, np.float32(2.5))
                continue
            if behind > np.float32(0.0):
                out[11, i, j] = bounded((behind - z) / np.float32(_CAME_M), 3.0) - np.float32(_SAME)
            inverse = one / z
            scale = focal * inverse
            out[0, i, j] = min(inverse, np.float32(2.5))
            out[1, i, j] = bounded(
                (z - mean_around(sums, counts, i, j, int(narrow * scale + half), rows, cols)) / narrow, 3.0
            )
            out[2, i, j] = bounded(
                (z - mean_around(sums, counts, i, j, int(wide * scale + half), rows, cols)) / wide, 3.0
            )
            out[3, i, j] = one
            out[4, i, j] = _LOG_TABLE[min(int(z * np.float32(_LOG_STEPS)), _LOG_TABLE.size - 1)] + log_focal
            out[7, i, j] = slope(grid, i, j, 0, 1, rows, cols, scale)
            out[8, i, j] = slope(grid, i, j, 1, 0, rows, cols, scale)
            out[9, i, j] = bounded(slope_y * z, 3.0)


@njit(cache=True)
def bounded(value, most):
    """Clip a value to plus and minus ``most``."""
    return min(np.float32(most), max(np.float32(-most), value))


@njit(cache=True)
def mean_around(sums, counts, i, j, reach, rows, cols):
    """Compute the mean depth within ``reach`` pixels, at least one, up, down, left and right."""
    r = max(1, reach)
    u, v = max(0, i - r), min(rows, i + r + 1)
    p, q = max(0, j - r), min(cols, j + r + 1)
    total = sums[v, q] - sums[u, q] - sums[v, p] + sums[u, p]
    return np.float32(total / (counts[v, q] - counts[u, q] - counts[v, p] + counts[u, p]))


@njit(cache=True)
def slope(grid, i, j, down, right, rows, cols, scale):
    """Compute the rise of the depth per metre along the image, from one or two neighbours, within -2 to 2."""
    a, b, c, d = i - down, j - right, i + down, j + right
    before = grid[a, b] if a >= 0 and b >= 0 else np.float32(0.0)
    after = grid[c, d] if c < rows and d < cols else np.float32(0.0)
    z = grid[i, j]
    if before > 0.0 and after > 0.0:
        rise = np.float32(0.5) * (after - before)
    elif after > 0.0:
        rise = after - z
    elif before > 0.0:
        rise = z - before
    else:
        return np.float32(0.0)
    return bounded(rise * scale, 2.0)


@njit(cache=True)
def unpack(packed, out):
    """Rearrange four channels to two by two pixels: ``packed`` (4 C, h, w) to ``out`` (C, 2 h, 2 w)."""
    for c in range(out.shape[0]):
        for i in range(packed.shape[1]):
            for a in range(2):
                left, right, row = packed[4 * c + 2 * a, i], packed[4 * c + 2 * a + 1, i], out[c, 2 * i + a]
                for j in range(packed.shape[2]):
                    row[2 * j], row[2 * j + 1] = left[j], right[j]
