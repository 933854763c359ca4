"""Compiled loops that prepare a person's window for the fit."""

from __future__ import annotations

from depth_pose.core.kernels import njit


@njit(cache=True)
def nearest_person(labels, nearest):
    """Find row and column of the approximately nearest person pixel for every pixel, in two sweeps."""
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
