"""Compiled exact search for nearest neighbours; `depth_pose.steps.search` says how it works."""

from __future__ import annotations

import numpy as np
from numba import njit

BLOCK = 512
"""Entries whose bounds are computed together; all of a block's sums stay in the fastest cache."""


@njit(cache=True, fastmath=True)
def bound_distances(head, rest_norms, gamma, gamma_rest, bounds, best):
    """Lower bounds of squared distances: exact in the head's dimensions, and in the others by norms.

    ``head`` is (K, N), ``rest_norms`` (N,) the entries' lengths in all other dimensions. By the
    triangle inequality the others add at least ``(rest_norms - gamma_rest)^2``. ``best`` gets each
    block's entry with the lowest bound.
    """
    dimensions, count = head.shape
    for block in range(best.shape[0]):
        start, end = block * BLOCK, min((block + 1) * BLOCK, count)
        out, norms = bounds[start:end], rest_norms[start:end]
        for i in range(out.shape[0]):
            gap = norms[i] - gamma_rest
            out[i] = gap * gap
        for k in range(dimensions):
            g, row = gamma[k], head[k, start:end]
            for i in range(out.shape[0]):
                gap = row[i] - g
                out[i] += gap * gap
        best[block] = start + np.argmin(out)


@njit(cache=True, fastmath=True)
def squared_distance(entry, gamma):
    """Squared distance in all dimensions."""
    total = np.float32(0.0)
    for k in range(gamma.shape[0]):
        gap = entry[k] - gamma[k]
        total += gap * gap
    return total


@njit(cache=True)
def insert(distance, entry, distances, entries, filled):
    """Insert into a list kept in ascending order, whose last element falls out where it is full."""
    at = filled if filled < distances.shape[0] else filled - 1
    while at > 0 and (
        distances[at - 1] > distance or (distances[at - 1] == distance and entries[at - 1] > entry)
    ):
        distances[at] = distances[at - 1]
        entries[at] = entries[at - 1]
        at -= 1
    distances[at] = distance
    entries[at] = entry


@njit(cache=True)
def search(table, bounds, best, gamma, distances, entries):
    """Find the nearest entries exactly, nearest first; most of the table is ruled out by its bounds."""
    count = distances.shape[0]
    distances[:] = np.inf
    entries[:] = -1
    blocks = np.sort(best)
    for b in range(blocks.shape[0]):
        i = blocks[b]
        d = squared_distance(table[i], gamma)
        if d < distances[count - 1]:
            insert(d, i, distances, entries, count)
    nth = distances[count - 1]
    limit = nth * np.float32(1.0001)
    skip = 0
    for i in range(bounds.shape[0]):
        if bounds[i] > limit:
            continue
        while skip < blocks.shape[0] and blocks[skip] < i:
            skip += 1
        if skip < blocks.shape[0] and blocks[skip] == i:
            continue
        d = squared_distance(table[i], gamma)
        if d < nth:
            insert(d, i, distances, entries, count)
            nth = distances[count - 1]
            limit = nth * np.float32(1.0001)
