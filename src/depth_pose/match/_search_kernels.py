"""Compiled exact nearest-neighbour search; see `depth_pose.match.search`."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit

BLOCK = 512
"""Number of entries whose bounds are computed together, so that a block's sums stay in the fastest cache."""


@njit(cache=True, fastmath=True)
def bound_distances(head, steps, rest_norms, gamma, gamma_rest, bounds, best):
    """Compute lower bounds: rounded squared distances in the first dimensions, and norms in the others.

    Entry i is ``steps[k] * head[k, i]`` in dimension k of an even number, with norm ``rest_norms[i]`` in the
    others. ``best`` receives each block's entry with the lowest bound.
    """
    dimensions, count = head.shape
    for block in range(best.shape[0]):
        start, end = block * BLOCK, min((block + 1) * BLOCK, count)
        out, norms = bounds[start:end], rest_norms[start:end]
        for i in range(out.shape[0]):
            gap = norms[i] - gamma_rest
            out[i] = gap * gap
        for k in range(0, dimensions, 2):  # two at a time: half as many passes over the sums
            here, step, g = head[k, start:end], steps[k], gamma[k]
            here2, step2, g2 = head[k + 1, start:end], steps[k + 1], gamma[k + 1]
            for i in range(out.shape[0]):
                gap, gap2 = np.float32(here[i]) * step - g, np.float32(here2[i]) * step2 - g2
                out[i] += gap * gap + gap2 * gap2
        best[block] = start + np.argmin(out)


@njit(cache=True, fastmath=True)
def joint_distances(squares, local, weights, pulls, out):
    """Compute weighted squared distances of known joints to other joints, without the common terms.

    Parameters
    ----------
    squares, local : (J, N), (3 J, N) float32
        Squared norms, and coordinates, of the joints of N poses.
    weights, pulls : (R, J), (R, 3 J) float32
        Joint weights of R queries, and twice the weighted coordinates.
    out : (R, N) float32
        Written.
    """
    count = squares.shape[1]
    for start in range(0, count, BLOCK):
        end = min(start + BLOCK, count)
        for r in range(out.shape[0]):
            total = out[r, start:end]
            total[:] = np.float32(0.0)
            for k in range(squares.shape[0]):
                w, square = weights[r, k], squares[k, start:end]
                a, b, c = pulls[r, 3 * k], pulls[r, 3 * k + 1], pulls[r, 3 * k + 2]
                x, y, z = local[3 * k, start:end], local[3 * k + 1, start:end], local[3 * k + 2, start:end]
                for i in range(total.shape[0]):
                    total[i] += w * square[i] - (a * x[i] + b * y[i] + c * z[i])


@njit(cache=True)
def least_of_rows(values, count):
    """Return the indices (R, count) of the least values of each row of (R, N), ascending.

    Of equal values the first is returned.
    """
    out, kept = np.empty((values.shape[0], count), np.int64), np.empty(count, values.dtype)
    for r in range(values.shape[0]):
        kept[:] = np.inf
        out[r] = -1
        filled = 0
        for i in range(values.shape[1]):
            if filled < count or values[r, i] < kept[count - 1]:
                insert(values[r, i], i, kept, out[r], filled)
                filled = min(filled + 1, count)
    return out


@njit(cache=True, fastmath=True, forceinline=True)
def squared_distance(entry, gamma):
    """Compute the squared distance in all dimensions."""
    total = np.float32(0.0)
    for k in range(gamma.shape[0]):
        gap = entry[k] - gamma[k]
        total += gap * gap
    return total


@njit(cache=True)
def insert(distance, entry, distances, entries, filled):
    """Insert into an ascending list; the last element of a full list is dropped."""
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
def limit_of(distance, slack):
    """Compute the bound above which entries are farther, including the rounding of both."""
    root = np.sqrt(distance) * np.float32(1.0001) + slack
    return root * root


@njit(cache=True)
def search(table, bounds, slack, best, gamma, distances, entries):
    """Find the nearest entries exactly, nearest first; the bounds exclude most of the table.

    ``slack`` is the maximum by which rounding may have raised the root of a bound above the distance.
    """
    count = distances.shape[0]
    distances[:] = np.inf
    entries[:] = -1
    for i in best:
        d = squared_distance(table[i], gamma)
        if d < distances[count - 1]:
            insert(d, i, distances, entries, count)
        bounds[i] = np.inf  # done
    limit = limit_of(distances[count - 1], slack)
    for i in range(bounds.shape[0]):
        if bounds[i] > limit or bounds[i] == np.inf:
            continue
        d = squared_distance(table[i], gamma)
        if d < distances[count - 1] or (d == distances[count - 1] and i < entries[count - 1]):
            insert(d, i, distances, entries, count)
            limit = limit_of(distances[count - 1], slack)
