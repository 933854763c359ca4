"""Compiled loops that judge and repair a sensor's depth image, for `depth_pose.detect.input_repair`.

A pixel is set if its depth is above 0 and finite; all others are holes.
"""

from __future__ import annotations

from math import ceil, floor

import numpy as np

from depth_pose.core.kernels import njit

LONGEST_GAP = 8
"""Longest distance (pixels) from a set pixel to the next one that counts as a gap of a grid."""

_REACH = 0.75
"""Distance (cells of the reduced grid) within which a depth is taken where a cell has none. Set by hand."""


@njit(cache=True, inline="always")
def is_set(z):
    """Whether a depth was measured."""
    return (z > 0.0) & (z < np.inf)


@njit(cache=True)
def count_rims(depth, step, flat, low, high):
    """Count the holes' borders in every ``step``-th row, and those with a depth between hole and surface.

    A border is a hole followed, to the left or right, by four set pixels of which the last two differ by
    less than the share ``flat``: they are the surface. Its first pixel is a rim if its depth is between the
    shares ``low`` and ``high`` of the surface's.
    """
    rows, cols = depth.shape
    borders = rims = 0
    for i in range(0, rows, step):
        row = depth[i]
        for j in range(cols - 4):
            opens, closes = not is_set(row[j]), not is_set(row[j + 4])
            if opens == closes:
                continue
            first, second, third, last = row[j + 1], row[j + 2], row[j + 3], row[j + 4]
            if closes:
                first, second, third, last = row[j + 3], row[j + 2], row[j + 1], row[j]
            if not (is_set(first) & is_set(second) & is_set(third)):
                continue
            if abs(third - last) < flat * third:
                borders += 1
                rims += (first > low * third) & (first < high * third)
    return borders, rims


@njit(cache=True)
def count_squares(depth, step):
    """Count squares of 2 x 2 pixels in every ``step``-th row: with a set pixel; full; irregular.

    A regular grid of lines that is thinned by whole rows and columns has no square with three set pixels,
    or with two on a diagonal: these are irregular.
    """
    rows, cols = depth.shape
    used = full = irregular = 0
    for i in range(0, rows - 1, step):
        upper, lower = depth[i], depth[i + 1]
        a, c = is_set(upper[0]), is_set(lower[0])
        for j in range(1, cols):
            b, d = is_set(upper[j]), is_set(lower[j])
            count = int(a) + int(b) + int(c) + int(d)
            used += count > 0
            full += count == 4
            irregular += (count == 3) | ((count == 2) & (a == d))
            a, c = b, d
    return used, full, irregular


@njit(cache=True)
def count_gaps(depth, step, counts):
    """Add the distances (pixels) between neighbouring set pixels of every ``step``-th row to ``counts``.

    ``counts`` has the number of each distance from 0 to `LONGEST_GAP`; longer ones are not counted.
    """
    rows, cols = depth.shape
    for i in range(0, rows, step):
        last = -LONGEST_GAP - 1
        for j in range(cols):
            if is_set(depth[i, j]):
                if j - last <= LONGEST_GAP:
                    counts[j - last] += 1
                last = j


@njit(cache=True)
def remove_rims(depth, rise):
    """Return a copy without pixels beside holes, pits, and mixed pixels on depth steps.

    A pit is nearer than both of its neighbours in its row or its column by the share ``rise``; a mixed
    pixel lies between the two, farther than one and nearer than the other by that share.
    """
    rows, cols = depth.shape
    out = np.zeros((rows, cols), np.float32)
    for i in range(rows):
        for j in range(cols):
            z = depth[i, j]
            if not is_set(z) or touches_hole(depth, i, j):
                continue
            is_rim = False
            if (j > 0) & (j < cols - 1):
                is_rim = is_between(depth[i, j - 1], z, depth[i, j + 1], rise)
            if (i > 0) & (i < rows - 1):
                is_rim |= is_between(depth[i - 1, j], z, depth[i + 1, j], rise)
            if not is_rim:
                out[i, j] = z
    return out


@njit(cache=True)
def touches_hole(depth, i, j):
    """Whether one of the eight neighbours of a pixel is a hole; the image's border is none."""
    rows, cols = depth.shape
    for a in range(max(0, i - 1), min(rows, i + 2)):
        for b in range(max(0, j - 1), min(cols, j + 2)):
            if not is_set(depth[a, b]):
                return True
    return False


@njit(cache=True, inline="always")
def is_between(before, z, after, rise):
    """Whether a depth is a pit, or lies on the step, between the two depths beside it."""
    low, high, more = min(before, after), max(before, after), 1.0 + rise
    return (z * more < low) | ((low * more < z) & (z * more < high))


@njit(cache=True)
def reduce_grid(depth, rows, cols):
    """Reduce a sparse grid to one of ``rows`` x ``cols`` pixels, which is dense.

    A pixel takes the least depth that is set in its cell, as the background may show between the pixels of a
    foreground; where none is set, the nearest one within `_REACH` cells of its centre.
    """
    height, width = depth.shape
    out = np.zeros((rows, cols), np.float32)
    tall, wide = height / rows, width / cols
    for i in range(rows):
        v = (i + 0.5) * tall - 0.5
        for j in range(cols):
            u = (j + 0.5) * wide - 0.5
            nearest, away = np.float32(0.0), np.inf
            for a in range(max(0, ceil(v - _REACH * tall)), min(height, floor(v + _REACH * tall) + 1)):
                for b in range(max(0, ceil(u - _REACH * wide)), min(width, floor(u + _REACH * wide) + 1)):
                    z = depth[a, b]
                    if not is_set(z):
                        continue
                    off = max(abs(a - v) / tall, abs(b - u) / wide)
                    off = 0.0 if off <= 0.5 else off
                    if (off < away) | ((off == away) & (z < nearest)):
                        nearest, away = z, off
            out[i, j] = nearest
    return out
