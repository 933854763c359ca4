"""Compiled loops that corrupt the mask of a crop with the errors that a people finder makes."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def clear_near(whose, row, col, reach):
    """Remove the person's pixels within ``reach`` pixels of a place from the mask."""
    side = whose.shape[0]
    for i in range(max(0, int(row - reach)), min(side, int(row + reach) + 2)):
        for j in range(max(0, int(col - reach)), min(side, int(col + reach) + 2)):
            if whose[i, j] == 1 and (i - row) ** 2 + (j - col) ** 2 < reach**2:
                whose[i, j] = 0


@njit(cache=True)
def grow_into(grid, whose, row, col, reach, most):
    """Add the pixels within ``reach`` pixels of a place, and ``most`` metres of its depth, to the mask."""
    side, z = whose.shape[0], grid[row, col]
    for i in range(max(0, int(row - reach)), min(side, int(row + reach) + 2)):
        for j in range(max(0, int(col - reach)), min(side, int(col + reach) + 2)):
            near = (i - row) ** 2 + (j - col) ** 2 < reach**2
            if near and whose[i, j] >= 0 and grid[i, j] > 0.0 and abs(grid[i, j] - z) < most:
                whose[i, j] = 1


@njit(cache=True)
def thin_edge(whose, share, draws):
    """Remove a share of the mask's edge pixels."""
    side = whose.shape[0]
    lost = np.zeros(whose.shape, np.bool_)
    for i in range(side):
        for j in range(side):
            if whose[i, j] != 1 or draws[i, j] >= share:
                continue
            whole = 0 < i < side - 1 and 0 < j < side - 1
            if not (
                whole
                and whose[i - 1, j] == 1
                and whose[i + 1, j] == 1
                and whose[i, j - 1] == 1
                and whose[i, j + 1] == 1
            ):
                lost[i, j] = True
    for i in range(side):
        for j in range(side):
            if lost[i, j]:
                whose[i, j] = 0
