"""Compiled loops that find the nearest person pixel of every pixel."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit

_NOWHERE = -10000
"""Row and column of a person pixel that was not found yet."""


@njit(cache=True)
def nearest_person(labels, nearest):
    """Find row and column of the approximately nearest person pixel for every pixel, in two sweeps.

    Each row takes over from the row before it, and then along itself. The first step is vectorised: rows
    and columns of the nearest pixels lie in arrays of their own, with one column more at both ends.
    """
    rows, cols = labels.shape
    row, col = np.full((rows, cols + 2), _NOWHERE, np.int32), np.full((rows, cols + 2), _NOWHERE, np.int32)
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] == 1:
                row[i, j + 1], col[i, j + 1] = i, j
    for i in range(rows):
        if i > 0:
            take_over(row[i - 1], col[i - 1], i, row[i], col[i])
        pass_along(i, 1, cols, 1, row[i], col[i])
    for i in range(rows - 1, -1, -1):
        if i < rows - 1:
            take_over(row[i + 1], col[i + 1], i, row[i], col[i])
        pass_along(i, cols, 1, -1, row[i], col[i])
    for i in range(rows):
        for j in range(cols):
            nearest[i, j, 0], nearest[i, j, 1] = row[i, j + 1], col[i, j + 1]


@njit(cache=True)
def take_over(row_before, col_before, i, row, col):
    """Take the nearest pixels of the three neighbours in the row before, where they are nearer."""
    for shift in range(-1, 2):
        for k in range(1, row.shape[0] - 1):
            p, q, r, s = row_before[k + shift], col_before[k + shift], row[k], col[k]
            down, across = np.int32(p - i), np.int32(q - k + 1)
            now_down, now_across = np.int32(r - i), np.int32(s - k + 1)
            is_nearer = down * down + across * across < now_down * now_down + now_across * now_across
            row[k], col[k] = p if is_nearer else r, q if is_nearer else s


@njit(cache=True)
def pass_along(i, first, last, step, row, col):
    """Take the nearest pixel of the neighbour before in the row, where it is nearer."""
    for k in range(first + step, last + step, step):
        p, q, r, s = row[k - step], col[k - step], row[k], col[k]
        if (p - i) ** 2 + (q - k + 1) ** 2 < (r - i) ** 2 + (s - k + 1) ** 2:
            row[k], col[k] = p, q
