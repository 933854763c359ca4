"""Compiled loops of coherent point drift; `depth_pose.paper.cpd` derives them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from depth_pose.core._fast_exp import CUT, gauss
from depth_pose.core._grid_kernels import Grid, bounds, sort_into_cells
from depth_pose.core.kernels import njit

_CELL_M = 0.04
"""Least side of the grid's cells (m); affects only speed."""

_MOST_CELLS = 128
"""Maximum number of cells along the longer side of the grid."""

_LEAST_MASS = 1e-8
"""Source points with less responsibility than this are ignored in the M-step."""

_LEAST_EXPLAINED = 1e-3
"""With fewer explained target points in total, nothing is in reach and the iteration stops."""

_STILL = 1e-3
"""The iteration stops when the variance falls by less than this share."""


class DriftSettings(NamedTuple):
    """Settings of `drift`, explained in ``depth_pose.paper.cpd``; variances in square metres."""

    stiffness: float
    sigma2: float
    floor2: float
    outlier_factor: float
    tolerance: float
    most: int


@njit(cache=True, fastmath=True, forceinline=True)
def sort_into_grid(target: Any) -> Any:
    """Sort points by the cells of a grid over x and y, so that a row of cells is contiguous.

    Returns the sorted points (3, N) float32, the first point of each cell, and the grid.
    """
    every = np.ones(target.shape[0], np.bool_)
    low_x, low_y, high_x, high_y = bounds(target, every)
    size = max(_CELL_M, max(high_x - low_x, high_y - low_y) / _MOST_CELLS)
    cols, rows = int((high_x - low_x) / size) + 1, int((high_y - low_y) / size) + 1
    grid = Grid(low_x, low_y, size, rows, cols)
    order, first = sort_into_cells(target, every, grid)
    out = np.empty((3, target.shape[0]), np.float32)
    for j in range(order.shape[0]):
        for a in range(3):
            out[a, j] = target[order[j], a]
    return out, first, grid


@njit(cache=True, fastmath=True, forceinline=True)
def _weigh_run(run: Any, centre: Any, inverse: Any, kernel: Any, total: Any) -> None:
    (tx, ty, tz), (x, y, z) = run, centre
    for n in range(tx.shape[0]):
        dx, dy, dz = tx[n] - x, ty[n] - y, tz[n] - z
        k = gauss((dx * dx + dy * dy + dz * dz) * inverse)
        kernel[n] = k
        total[n] += k


@njit(cache=True, fastmath=True, forceinline=True)
def _sum_run(run: Any, centre: Any, kernel: Any, share: Any) -> Any:
    (tx, ty, tz), (x, y, z) = run, centre
    p1 = px = py = pz = p2 = np.float32(0.0)
    for n in range(tx.shape[0]):
        p = kernel[n] * share[n]
        dx, dy, dz = tx[n] - x, ty[n] - y, tz[n] - z
        p1 += p
        px += p * dx
        py += p * dy
        pz += p * dz
        p2 += p * (dx * dx + dy * dy + dz * dz)
    return p1, px, py, pz, p2


@njit(cache=True, fastmath=True, forceinline=True)
def expect(
    moved: Any, sigma2: Any, outlier: Any, grid: Any, kernel: Any, total: Any, p1: Any, residual: Any
) -> Any:
    """Run the E-step of CPD: ``p1[m] = sum_n p_mn``, ``residual[m] = sum_n p_mn (x_n - t_m)``.

    Returns ``sum_mn p_mn |x_n - t_m|^2``. ``total`` holds ``sum_n`` of each target's posteriors
    (Pt1) afterwards, in the order of the grid.
    """
    points, first, cells = grid
    low_x, low_y, size, rows, cols = cells
    tx, ty, tz = points[0], points[1], points[2]
    reach = np.sqrt(2.0 * CUT * sigma2)
    inverse = np.float32(0.5 / sigma2)
    total[:] = 0.0
    for sweep in range(2):
        at, squares = 0, 0.0
        for m in range(moved.shape[0]):
            top = max(0, int(np.floor((moved[m, 1] - reach - low_y) / size)))
            bottom = min(rows - 1, int(np.floor((moved[m, 1] + reach - low_y) / size)))
            left = max(0, int(np.floor((moved[m, 0] - reach - low_x) / size)))
            right = min(cols - 1, int(np.floor((moved[m, 0] + reach - low_x) / size)))
            centre = (np.float32(moved[m, 0]), np.float32(moved[m, 1]), np.float32(moved[m, 2]))
            if sweep == 1:
                p1[m] = residual[m, 0] = residual[m, 1] = residual[m, 2] = 0.0
            if left > right:
                continue
            for row in range(top, bottom + 1):
                begin, end = first[row * cols + left], first[row * cols + right + 1]
                run, weights = (tx[begin:end], ty[begin:end], tz[begin:end]), kernel[at : at + end - begin]
                if sweep == 0:
                    _weigh_run(run, centre, inverse, weights, total[begin:end])
                else:
                    s = _sum_run(run, centre, weights, total[begin:end])
                    p1[m] += s[0]
                    residual[m, 0] += s[1]
                    residual[m, 1] += s[2]
                    residual[m, 2] += s[3]
                    squares += s[4]
                at += end - begin
        if sweep == 0:
            for n in range(total.shape[0]):
                total[n] = 1.0 / (total[n] + outlier)
    for n in range(total.shape[0]):
        total[n] = 1.0 - outlier * total[n]
    return squares


@njit(cache=True, fastmath=True, forceinline=True)
def _add_normal_equations(basis: Any, p1: Any, residual: Any, shift: Any, matrix: Any, right: Any) -> None:
    """Add ``B^T diag(p1) B`` (lower half) and ``B^T (residual + diag(p1) shift)``, four rows at a time."""
    count = basis.shape[1]
    matrix[:] = 0.0
    right[:] = 0.0
    used = np.empty(p1.shape[0] + 3, np.int64)
    n = 0
    for m in range(p1.shape[0]):
        if p1[m] > _LEAST_MASS:
            used[n] = m
            n += 1
            for a in range(3):
                r = residual[m, a] + p1[m] * shift[m, a]
                for i in range(count):
                    right[a, i] += basis[m, i] * r
    weighted = np.empty((4, count))
    rows = np.zeros((4, count))
    for block in range(0, n, 4):
        for b in range(4):
            if block + b < n:
                m = used[block + b]
                for i in range(count):
                    rows[b, i] = basis[m, i]
                    weighted[b, i] = basis[m, i] * p1[m]
            else:
                weighted[b, :] = 0.0
        for i in range(count):
            w0, w1, w2, w3 = weighted[0, i], weighted[1, i], weighted[2, i], weighted[3, i]
            for j in range(i + 1):
                matrix[i, j] += w0 * rows[0, j] + w1 * rows[1, j] + w2 * rows[2, j] + w3 * rows[3, j]


@njit(cache=True, fastmath=True, forceinline=True)
def _solve(matrix: Any, right: Any) -> None:
    """Solve by Cholesky in the lower half of ``matrix``; the rows of ``right`` become the solutions."""
    n = matrix.shape[0]
    for j in range(n):
        for i in range(j):
            s = 0.0
            for k in range(i):
                s += matrix[j, k] * matrix[i, k]
            matrix[j, i] = (matrix[j, i] - s) / matrix[i, i]
        s = 0.0
        for k in range(j):
            s += matrix[j, k] * matrix[j, k]
        matrix[j, j] = np.sqrt(matrix[j, j] - s)
    for a in range(right.shape[0]):
        for i in range(n):
            s = 0.0
            for k in range(i):
                s += matrix[i, k] * right[a, k]
            right[a, i] = (right[a, i] - s) / matrix[i, i]
        for i in range(n - 1, -1, -1):
            right[a, i] /= matrix[i, i]
            for k in range(i):
                right[a, k] -= matrix[i, k] * right[a, i]


@njit(cache=True)
def drift(source: Any, target: Any, basis: Any, settings: Any, moved: Any, p1: Any, residual: Any) -> Any:
    """Run all iterations of coherent point drift.

    ``moved``, ``p1``, ``residual`` are written. Returns the last sigma squared, the share of explained
    targets, and the number of iterations.
    """
    grid = sort_into_grid(target)
    count = basis.shape[1]
    matrix = np.empty((count, count))
    right = np.empty((3, count))
    kernel = np.empty(source.shape[0] * target.shape[0], np.float32)
    total = np.empty(target.shape[0], np.float32)
    shift = np.zeros(source.shape)
    step = np.empty(3)
    moved[:] = source
    explained, iterations, sigma2 = 0.0, 0, settings.sigma2
    while True:
        outlier = np.float32(settings.outlier_factor * (2.0 * np.pi * sigma2) ** 1.5)
        squares = expect(moved, sigma2, outlier, grid, kernel, total, p1, residual)
        explained = p1.sum()
        if iterations == settings.most or explained < _LEAST_EXPLAINED:
            break
        _add_normal_equations(basis, p1, residual, shift, matrix, right)
        for i in range(count):
            matrix[i, i] += settings.stiffness * sigma2
        _solve(matrix, right)
        farthest = 0.0
        for m in range(source.shape[0]):
            size = 0.0
            for a in range(3):
                new = 0.0
                for i in range(count):
                    new += basis[m, i] * right[a, i]
                step[a] = new - shift[m, a]
                shift[m, a] = new
                moved[m, a] = source[m, a] + new
                squares += step[a] * (p1[m] * step[a] - 2.0 * residual[m, a])
                size += step[a] * step[a]
            farthest = max(farthest, size)
        iterations += 1
        last = sigma2
        sigma2 = min(sigma2, max(settings.floor2, squares / (3.0 * explained)))
        sigma2 = max(sigma2, settings.floor2)
        if farthest < settings.tolerance * settings.tolerance and last - sigma2 < _STILL * last:
            break
    return sigma2, explained / target.shape[0], iterations


@njit(cache=True)
def follow(
    vertices: Any, before: Any, moved: Any, probability: Any, reach: Any, targets: Any, mass: Any
) -> Any:
    """Move each vertex to the weighted mean of the new places of the points around it.

    The weight is ``exp(-4.5 d^2 / reach^2)`` times the point's probability, and 0 beyond 1.2 times ``reach``.
    ``mass`` (V,) is the sum of weights. ``targets`` (V, 3) may be ``vertices``; those of vertices without
    points are unchanged.
    """
    steep, most = 4.5 / (reach * reach), (1.2 * reach) ** 2
    for v in range(vertices.shape[0]):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        total, tx, ty, tz = 0.0, 0.0, 0.0, 0.0
        for n in range(before.shape[0]):
            dx, dy, dz = before[n, 0] - x, before[n, 1] - y, before[n, 2] - z
            far = dx * dx + dy * dy + dz * dz
            if far < most:
                w = np.exp(-steep * far) * min(probability[n], 1.0)
                total += w
                tx += w * moved[n, 0]
                ty += w * moved[n, 1]
                tz += w * moved[n, 2]
        mass[v] = total
        if total > 0.0:
            targets[v, 0], targets[v, 1], targets[v, 2] = tx / total, ty / total, tz / total
