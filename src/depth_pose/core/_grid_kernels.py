"""Sort points into the cells of a grid over x and y, for fast neighbour search."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from depth_pose.core.kernels import njit


class Grid(NamedTuple):
    """Square cells: minimum x and y (m), side (m), numbers of rows and columns."""

    low_x: Any
    low_y: Any
    size: Any
    rows: Any
    cols: Any


@njit(cache=True, fastmath=True, forceinline=True)
def bounds(points, chosen):
    """Minimum and maximum x and y of the selected points."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(points.shape[0]):
        if chosen[i]:
            low_x, high_x = min(low_x, points[i, 0]), max(high_x, points[i, 0])
            low_y, high_y = min(low_y, points[i, 1]), max(high_y, points[i, 1])
    return low_x, low_y, high_x, high_y


@njit(cache=True, fastmath=True, forceinline=True)
def sort_into_cells(points, chosen, grid):
    """Sort the selected points into a grid's cells.

    Returns their indices in the order of the cells, row by row, and the start of each cell (rows * cols + 1).
    Points outside the grid are left out.
    """
    start = np.zeros(grid.rows * grid.cols + 1, np.int32)
    cell = np.full(points.shape[0], -1, np.int32)
    for i in range(points.shape[0]):
        if chosen[i]:
            row, col = (points[i, 1] - grid.low_y) / grid.size, (points[i, 0] - grid.low_x) / grid.size
            if row >= 0.0 and col >= 0.0 and row < grid.rows and col < grid.cols:
                cell[i] = int(row) * grid.cols + int(col)
                start[cell[i] + 1] += 1
    for k in range(grid.rows * grid.cols):
        start[k + 1] += start[k]
    fill = start[:-1].copy()
    order = np.empty(start[-1], np.int32)
    for i in range(points.shape[0]):
        if cell[i] >= 0:
            order[fill[cell[i]]] = i
            fill[cell[i]] += 1
    return order, start
