"""Thin out and select rows by their distances; fastest where the first columns vary most."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.kernels import njit


@njit(cache=True)
def keep_apart(rows: NDArray[np.float32], limit: np.float32) -> NDArray[np.bool_]:
    """Mark the rows whose squared distance to every row marked before is at least ``limit``."""
    n, width = rows.shape
    kept = np.empty(n, np.int64)
    mark = np.zeros(n, np.bool_)
    count = 0
    for i in range(n):
        near = False
        # The latest first: in a recording the neighbour in time is the likeliest duplicate.
        for j in range(count - 1, -1, -1):
            total = np.float32(0.0)
            for k in range(width):
                d = rows[i, k] - rows[kept[j], k]
                total += d * d
                if total >= limit:
                    break
            if total < limit:
                near = True
                break
        if not near:
            kept[count] = i
            count += 1
            mark[i] = True
    return mark


def farthest_rows(
    rows: NDArray[np.floating],
    count: int,
    start: int | None = None,
    images: NDArray[np.floating] | None = None,
    weights: NDArray[np.floating] | None = None,
) -> NDArray[np.int64]:
    """Choose rows far from each other, greedily: the next is the farthest from those chosen before.

    T. F. Gonzalez, *Clustering to minimize the maximum intercluster distance*, Theor. Comput.
    Sci. 38, 1985.

    Parameters
    ----------
    rows : (N, K) float32 or float64
    count : int
        Number of rows, at most all.
    start : int, optional
        The first; by default the row nearest to the mean.
    images : (N, K), optional
        A chosen row stands for its image too.
    weights : (N,), optional
        Factor on each row's squared distance.

    Returns
    -------
    (count,) int64
        In the order of choice.
    """
    rows = np.ascontiguousarray(rows)
    if start is None:
        start = int(np.argmin(np.square(rows - rows.mean(axis=0)).sum(axis=1)))
    images = rows[:0] if images is None else images
    weights = np.ones(len(rows), rows.dtype) if weights is None else weights
    return np.asarray(_choose(rows, images, weights, min(count, len(rows)), start))


@njit(cache=True)
def nearest_points(rows: Any, points: Any) -> Any:
    """Return the index of the point nearest to each row, the first of equals."""
    numbers = np.zeros(len(rows), np.int32)
    for i in range(len(rows)):
        least = np.inf
        for j in range(len(points)):
            total = 0.0
            for k in range(rows.shape[1]):
                d = rows[i, k] - points[j, k]
                total += d * d
                if k & 3 == 3 and total >= least:
                    break
            if total < least:
                least = total
                numbers[i] = j
    return numbers


_FAR = 4.0001
"""A point whose squared distance to a row's nearest point is this multiple of the row's own cannot be nearer:
twice the distance (triangle inequality), and a margin for rounding.
"""


@njit(cache=True, fastmath=True, forceinline=True)
def _squared_distance(row: Any, point: Any, limit: Any) -> Any:
    """Squared distance, or any number from ``limit`` on."""
    total = np.float32(0.0)
    for k in range(len(row)):
        d = row[k] - point[k]
        total += d * d
        if k & 3 == 3 and total >= limit:
            break
    return total


@njit(cache=True)
def _lower(rows: Any, points: Any, nearest: Any, owners: Any, apart: Any) -> None:
    """Update every row's squared distance to the nearest point with that to the last point."""
    new = len(points) - 1
    for j in range(new):
        apart[j] = _squared_distance(points[j], points[new], np.inf)
    for i in range(len(rows)):
        if apart[owners[i]] < _FAR * nearest[i]:
            distance = _squared_distance(rows[i], points[new], nearest[i])
            if distance < nearest[i]:
                nearest[i], owners[i] = distance, new


@njit(cache=True)
def _choose(rows: Any, images: Any, weights: Any, count: int, start: int) -> Any:
    """Choose by weight times squared distance to the chosen rows and their images."""
    n = rows.shape[0]
    nearest, owners = np.full(n, 1e30, rows.dtype), np.zeros(n, np.int64)
    points = np.empty((2 * count, rows.shape[1]), rows.dtype)
    apart = np.zeros(2 * count, rows.dtype)
    used = 0
    chosen = np.empty(count, np.int64)
    chosen_mark = np.zeros(n, np.bool_)
    best = start
    for c in range(count):
        chosen[c] = best
        chosen_mark[best] = True
        points[used] = rows[best]
        used += 1
        _lower(rows, points[:used], nearest, owners, apart)
        if images.shape[0] > 0:
            points[used] = images[best]
            used += 1
            _lower(rows, points[:used], nearest, owners, apart)
        top = -1.0
        for i in range(n):
            value = nearest[i] * weights[i]
            if value > top and not chosen_mark[i]:
                top = value
                best = i
    return chosen
