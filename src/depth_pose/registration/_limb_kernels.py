"""Compiled loops of the limb search; `depth_pose.registration.limbs` says what they are for."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True)
def score_limbs(
    samples,
    radii,
    areas,
    rotation,
    origin,
    scale,
    depth,
    labels,
    nearest,
    fx,
    fy,
    cx,
    cy,
    points,
    tolerance,
    cost,
    cover,
):
    """Misfit of many limb configurations, in pixels, and what each leaves uncovered.

    ``samples`` (L, S, 3) are the centres of balls along the limb in the frame of the segment that
    it hangs on; ``cost`` (L,) gets the number of pixels that a limb puts into free space, behind
    what was seen, or elsewhere than the surface; ``cover`` (L, P) the share, 0 to 1, to which
    each point lies off the limb's surface.
    """
    rows, cols = depth.shape
    for k in range(samples.shape[0]):
        total = 0.0
        cover[k] = 1.0
        for s in range(samples.shape[1]):
            a0, a1, a2 = scale * samples[k, s, 0], scale * samples[k, s, 1], scale * samples[k, s, 2]
            x = origin[0] + rotation[0, 0] * a0 + rotation[0, 1] * a1 + rotation[0, 2] * a2
            y = origin[1] + rotation[1, 0] * a0 + rotation[1, 1] * a1 + rotation[1, 2] * a2
            z = origin[2] + rotation[2, 0] * a0 + rotation[2, 1] * a1 + rotation[2, 2] * a2
            r = scale * radii[s]
            far = (r + tolerance) * (r + tolerance)
            for p in range(points.shape[0]):
                dx, dy, dz = points[p, 0] - x, points[p, 1] - y, points[p, 2] - z
                square = dx * dx + dy * dy + dz * dz
                if square < far:
                    cover[k, p] = min(cover[k, p], abs(np.sqrt(square) - r) / tolerance)
            if z < 0.1:
                total += areas[s]
                continue
            i, j = int(np.rint(fy * y / z + cy)), int(np.rint(fx * x / z + cx))
            pixels = areas[s] * (scale * fx / z) * (scale * fy / z)
            if i < 0 or j < 0 or i >= rows or j >= cols:
                total += 0.3 * pixels
            elif labels[i, j] == 0:
                di, dj = (nearest[i, j, 0] - i) * z / fy, (nearest[i, j, 1] - j) * z / fx
                total += pixels * min(np.sqrt(di * di + dj * dj) / tolerance, 1.0)
            elif labels[i, j] == 2:
                total += 0.3 * pixels
            else:
                gap = depth[i, j] - (z - r)  # positive: the limb would stand before the surface
                if gap > 0.0:
                    total += pixels * min(gap / tolerance, 1.0)
                else:
                    total += pixels * min(-gap / tolerance, 0.3)
        cost[k] = total


@njit(cache=True, fastmath=True)
def best_pair(cost_a, cover_a, order_a, cost_b, cover_b, order_b):
    """Pair of configurations, one of each limb, with the least cost and uncovered points together."""
    best, best_a, best_b = np.inf, 0, 0
    for a in order_a:
        for b in order_b:
            total = cost_a[a] + cost_b[b]
            if total >= best:
                continue
            for p in range(cover_a.shape[1]):
                total += min(cover_a[a, p], cover_b[b, p])
            if total < best:
                best, best_a, best_b = total, a, b
    return best_a, best_b, best


@njit(cache=True)
def farthest_rows(rows, count):
    """Choose rows far from each other, one after the other, from the first on (squared distances)."""
    chosen = np.zeros(count, np.int64)
    nearest = np.full(rows.shape[0], np.inf)
    for c in range(1, count):
        last, best = rows[chosen[c - 1]], -1.0
        for i in range(rows.shape[0]):
            total = 0.0
            for k in range(rows.shape[1]):
                d = rows[i, k] - last[k]
                total += d * d
            nearest[i] = min(nearest[i], total)
            if nearest[i] > best:
                best, chosen[c] = nearest[i], i
    return chosen
