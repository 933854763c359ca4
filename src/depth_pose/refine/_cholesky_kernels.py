"""Sparse Cholesky of a matrix with a fixed pattern; `depth_pose.paper.laplacian` uses it.

The analysis follows T. A. Davis, *Direct Methods for Sparse Linear Systems*, SIAM 2006, chapter 4:
elimination tree, pattern of the factor's columns. The factorisation is left-looking with a dense accumulator.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from depth_pose.core.kernels import njit


class Matrix(NamedTuple):
    """A symmetric matrix, both halves, in compressed columns: ``rows`` is ascending within each column."""

    first: Any
    rows: Any
    values: Any


class Pattern(NamedTuple):
    """Pattern of a factor below the diagonal, by rows and by columns, with the map between the two."""

    row_first: Any
    row_cols: Any
    place: Any
    col_first: Any
    col_rows: Any


class Factor(NamedTuple):
    """A Cholesky factor: entries below the diagonal, by columns, and the diagonal."""

    lower: Any
    diagonal: Any


@njit(cache=True)
def elimination_tree(first: Any, rows: Any) -> Any:
    """Compute the column parents of a symmetric matrix, given in full by sorted columns."""
    n = first.shape[0] - 1
    parent = np.full(n, -1, np.int64)
    ancestor = np.full(n, -1, np.int64)
    for k in range(n):
        for p in range(first[k], first[k + 1]):
            i = rows[p]
            while i != -1 and i < k:
                up = ancestor[i]
                ancestor[i] = k
                if up == -1:
                    parent[i] = k
                i = up
    return parent


@njit(cache=True)
def factor_pattern(first: Any, rows: Any, parent: Any) -> Any:
    """Compute the factor's pattern: for each row, the columns below the diagonal, ascending."""
    n = first.shape[0] - 1
    mark = np.full(n, -1, np.int64)
    row_first = np.zeros(n + 1, np.int64)
    for sweep in range(2):
        if sweep == 1:
            for k in range(n):
                row_first[k + 1] += row_first[k]
            row_cols = np.empty(row_first[n], np.int32)
        else:
            row_cols = np.empty(0, np.int32)
        mark[:] = -1
        for k in range(n):
            mark[k] = k
            count = 0
            for p in range(first[k], first[k + 1]):
                i = rows[p]
                while i < k and mark[i] != k:
                    mark[i] = k
                    if sweep == 1:
                        row_cols[row_first[k] + count] = i
                    count += 1
                    i = parent[i]
            if sweep == 0:
                row_first[k + 1] = count
            else:
                row_cols[row_first[k] : row_first[k] + count].sort()
    return row_first, row_cols


@njit(cache=True)
def columns_of_rows(row_first: Any, row_cols: Any) -> Any:
    """Convert rows of a strictly lower pattern to columns; return the new place of each entry as well."""
    n = row_first.shape[0] - 1
    col_first = np.zeros(n + 1, np.int64)
    for p in range(row_cols.shape[0]):
        col_first[row_cols[p] + 1] += 1
    for k in range(n):
        col_first[k + 1] += col_first[k]
    fill = col_first[:-1].copy()
    col_rows = np.empty(row_cols.shape[0], np.int32)
    place = np.empty(row_cols.shape[0], np.int32)
    for k in range(n):
        for p in range(row_first[k], row_first[k + 1]):
            j = row_cols[p]
            col_rows[fill[j]] = k
            place[p] = fill[j]
            fill[j] += 1
    return col_first, col_rows, place


@njit(cache=True, fastmath=True)
def factorise(matrix: Any, extra: Any, pattern: Any, factor: Any) -> None:
    """Factor ``A + diag(extra)`` of a `Matrix` into a `Factor` of a known `Pattern`."""
    first, rows, values = matrix.first, matrix.rows, matrix.values
    row_first, row_cols, place = pattern.row_first, pattern.row_cols, pattern.place
    col_first, col_rows = pattern.col_first, pattern.col_rows
    lower, diagonal = factor.lower, factor.diagonal
    n = first.shape[0] - 1
    column = np.zeros(n)
    for k in range(n):
        for p in range(first[k], first[k + 1]):
            if rows[p] >= k:
                column[rows[p]] = values[p]
        d = column[k] + extra[k]
        for p in range(row_first[k], row_first[k + 1]):
            j = row_cols[p]
            at = place[p]
            f = lower[at]
            d -= f * f
            for q in range(at + 1, col_first[j + 1]):
                column[col_rows[q]] -= f * lower[q]
        root = np.sqrt(d)
        diagonal[k] = root
        for q in range(col_first[k], col_first[k + 1]):
            i = col_rows[q]
            lower[q] = column[i] / root
            column[i] = 0.0
        column[k] = 0.0


@njit(cache=True, fastmath=True)
def substitute(pattern: Any, factor: Any, right: Any) -> None:
    """Solve for three right-hand sides (n, 3) in place."""
    col_first, col_rows = pattern.col_first, pattern.col_rows
    lower, diagonal = factor.lower, factor.diagonal
    n = diagonal.shape[0]
    for k in range(n):
        a, b, c = right[k, 0] / diagonal[k], right[k, 1] / diagonal[k], right[k, 2] / diagonal[k]
        right[k, 0], right[k, 1], right[k, 2] = a, b, c
        for q in range(col_first[k], col_first[k + 1]):
            i, f = col_rows[q], lower[q]
            right[i, 0] -= f * a
            right[i, 1] -= f * b
            right[i, 2] -= f * c
    for k in range(n - 1, -1, -1):
        a, b, c = right[k, 0], right[k, 1], right[k, 2]
        for q in range(col_first[k], col_first[k + 1]):
            i, f = col_rows[q], lower[q]
            a -= f * right[i, 0]
            b -= f * right[i, 1]
            c -= f * right[i, 2]
        right[k, 0], right[k, 1], right[k, 2] = a / diagonal[k], b / diagonal[k], c / diagonal[k]
