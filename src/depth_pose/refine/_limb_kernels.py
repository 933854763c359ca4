"""Compiled loops of the limb search; see `depth_pose.refine.limbs`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core._camera_kernels import project, ray
from depth_pose.core._select_kernels import kth_smallest
from depth_pose.core.kernels import njit
from depth_pose.core.types import PERSON

_OUT = 0.3
"""Cost of a ball, as a share of its area, where the limb cannot be observed; set by hand."""

_NEAR_M = 0.1
"""A ball nearer to the camera than this (m) costs its whole area."""


class Limb(NamedTuple):
    """Configurations of a limb, as balls along it.

    Attributes
    ----------
    samples : (L, S, 3) float64
        Centres in the frame of the parent segment, metres from its node at scale 1.
    radii, areas : (S,) float64
        Radii (m), and side-view areas of the limb (m^2).
    """

    samples: NDArray[np.float64]
    radii: NDArray[np.float64]
    areas: NDArray[np.float64]


class Anchor(NamedTuple):
    """Parent segment of a limb: rotation (3, 3) and node (3,), camera frame; and the body's scale."""

    rotation: NDArray[np.float64]
    origin: NDArray[np.float64]
    scale: float


class LimbSettings(NamedTuple):
    """Settings of `score_limbs`.

    Attributes
    ----------
    tolerance : float
        Distance (m) at which a point is not covered by a limb, and a ball counts as fully misplaced.
    keep : float
        Advantage of the current limb, pixels.
    fitting, best : int
        Number of configurations that are compared with the points after the image test, and number
        returned. The current limb is always returned.
    """

    tolerance: float
    keep: float
    fitting: int
    best: int


@njit(cache=True)
def is_in_view(nodes, bones, camera):
    """Check that at least half of the nodes of two limbs, ``bones`` (2, m), lie in the image."""
    inside = 0
    for side in range(2):
        for n in range(bones.shape[1]):
            x, y, z = nodes[bones[side, n]]
            u, v = project(camera, x, y, z)
            inside += u > 0 and v > 0 and u < camera.width and v < camera.height
    return inside >= 0.5 * bones.size


@njit(cache=True)
def unexplained(drawn, observed, explained, ahead):
    """Find observed points that a drawn part of the body does not explain.

    Parameters
    ----------
    drawn : (h, w) float32
        Rendered depth; infinite where nothing is drawn.
    observed : Observation
    explained, ahead : float
        A point is explained below the first depth difference (m), and in front of the body from the second.

    Returns
    -------
    points : (P, 3) float32
    is_before : (P,) bool
    """
    depth, labels, camera = observed.depth, observed.labels, observed.camera
    rows, cols = depth.shape
    points, before = np.empty((depth.size, 3), np.float32), np.empty(depth.size, np.bool_)
    count = 0
    for i in range(rows):
        for j in range(cols):
            z = depth[i, j]
            gap = drawn[i, j] - z
            if labels[i, j] != PERSON or abs(gap) < np.float32(explained):
                continue
            x, y = ray(camera, j, i)
            points[count, 0], points[count, 1], points[count, 2] = x * z, y * z, z
            before[count] = gap > np.float32(ahead) and np.isfinite(gap)
            count += 1
    return points[:count].copy(), before[:count].copy()


@njit(cache=True, fastmath=True, forceinline=True)
def place_balls(samples, anchor, balls):
    """Transform ball centres (S, 3) from the anchor's frame to the camera frame."""
    rotation, origin = anchor.rotation, anchor.origin
    for s in range(samples.shape[0]):
        x, y, z = samples[s, 0], samples[s, 1], samples[s, 2]
        for a in range(3):
            along = rotation[a, 0] * x + rotation[a, 1] * y + rotation[a, 2] * z
            balls[s, a] = origin[a] + anchor.scale * along


@njit(cache=True)
def place_own_balls(rotations, nodes, bones, ends, shares, scale, balls):
    """Place the balls (S, 3) of the current limb: one for each bone and share of its length."""
    s = 0
    for n in range(bones.shape[0]):
        r = rotations[bones[n]]
        for share in shares:
            for a in range(3):
                along = r[a, 0] * ends[n, 0] + r[a, 1] * ends[n, 1] + r[a, 2] * ends[n, 2]
                balls[s, a] = nodes[bones[n], a] + scale * share * along
            s += 1


@njit(cache=True, fastmath=True, forceinline=True)
def misfit(balls, limb, scale, observed, nearest, tolerance):
    """Compute how many pixels of a limb's balls lie in free space, behind or off the surface."""
    depth, labels, camera, areas = observed.depth, observed.labels, observed.camera, limb.areas
    rows, cols = depth.shape
    total = 0.0
    for s in range(balls.shape[0]):
        x, y, z = balls[s, 0], balls[s, 1], balls[s, 2]
        r = scale * limb.radii[s]
        if z < _NEAR_M:
            total += areas[s]
            continue
        u, v = project(camera, x, y, z)
        i, j = int(np.rint(v)), int(np.rint(u))
        pixels = areas[s] * (scale * camera.fx / z) * (scale * camera.fy / z)
        if i < 0 or j < 0 or i >= rows or j >= cols:
            total += _OUT * pixels
        elif labels[i, j] == 0:
            di, dj = (nearest[i, j, 0] - i) * z / camera.fy, (nearest[i, j, 1] - j) * z / camera.fx
            total += pixels * min(np.sqrt(di * di + dj * dj) / tolerance, 1.0)
        elif labels[i, j] == 2:
            total += _OUT * pixels
        else:
            gap = depth[i, j] - (z - r)  # positive: the limb is in front of the surface
            if gap > 0.0:
                total += pixels * min(gap / tolerance, 1.0)
            else:
                total += pixels * min(-gap / tolerance, _OUT)
    return total


@njit(cache=True, fastmath=True, forceinline=True)
def off_surface(balls, radii, scale, points, tolerance, cover):
    """Compute the share (P,), 0 to 1, to which each of the points (3, P) lies off the balls' surfaces."""
    inverse = np.float32(1.0 / tolerance)
    cover[:] = np.float32(1.0)
    for s in range(balls.shape[0]):
        x, y, z = np.float32(balls[s, 0]), np.float32(balls[s, 1]), np.float32(balls[s, 2])
        r = np.float32(scale * radii[s])
        for p in range(points.shape[1]):
            dx, dy, dz = points[0, p] - x, points[1, p] - y, points[2, p] - z
            off = abs(np.sqrt(dx * dx + dy * dy + dz * dz) - r) * inverse
            cover[p] = min(cover[p], off)


@njit(cache=True)
def score_limbs(limb, own, anchor, observed, nearest, points, weight, settings):
    """Find the configurations of a limb that agree best with the image and the points.

    Parameters
    ----------
    limb : Limb
    own : (S, 3)
        Balls of the current limb, camera frame; its index is L.
    anchor : Anchor
    observed : Observation
    nearest : (h, w, 2) int32
        Row and column of the nearest person pixel to every pixel.
    points, weight : (3, P) float32, int
        Observed points that the rest of the body does not explain; each represents ``weight`` pixels.
    settings : LimbSettings

    Returns
    -------
    chosen (B,), cost (B,), cover (B, P), centres (B, S, 3)
        Indices, misfit in pixels, share to which each point lies off the limb, and ball centres in the
        camera frame.
    """
    count, radii, scale, tolerance = limb.samples.shape[0], limb.radii, anchor.scale, settings.tolerance
    balls = np.empty(own.shape)
    cost = np.empty(count + 1)
    for k in range(count):
        place_balls(limb.samples[k], anchor, balls)
        cost[k] = misfit(balls, limb, scale, observed, nearest, tolerance)
    cost[count] = misfit(own, limb, scale, observed, nearest, tolerance) - settings.keep
    first = _least(cost, settings.fitting)
    cover = np.empty((first.shape[0], points.shape[1]), np.float32)
    centres = np.empty((first.shape[0], own.shape[0], 3))
    total = np.empty(first.shape[0])
    for n in range(first.shape[0]):
        if first[n] == count:
            centres[n] = own
        else:
            place_balls(limb.samples[first[n]], anchor, centres[n])
        off_surface(centres[n], radii, scale, points, tolerance, cover[n])
        total[n] = cost[first[n]] + weight * cover[n].sum()
    last = _least(total, settings.best)
    return first[last], cost[first[last]], cover[last], centres[last]


@njit(cache=True)
def _least(values, count):
    """Return the indices of the ``count`` least values, ascending.

    The last value is always included, as the last one.
    """
    own = values.shape[0] - 1
    limit = kth_smallest(values, count - 1) if count <= own else np.inf
    order, filled = np.empty(min(count, own + 1) + 1, np.int64), 0
    for i in range(own + 1):  # of equal values the first comes first
        if values[i] <= limit and (filled < count or values[i] < values[order[filled - 1]]):
            at = min(filled, count - 1)
            while at > 0 and values[order[at - 1]] > values[i]:
                order[at] = order[at - 1]
                at -= 1
            order[at] = i
            filled = min(filled + 1, count)
    kept = 0
    for i in order[:filled]:
        if i != own:
            order[kept] = i
            kept += 1
    order[kept] = own
    return order[: kept + 1]


@njit(cache=True, fastmath=True)
def pair_costs(cost_a, cover_a, cost_b, cover_b, weight):
    """Compute cost and uncovered points (A, B) of all pairs of configurations, one of each limb.

    ``weight`` is the number of pixels that each point represents.
    """
    total = np.empty((cost_a.shape[0], cost_b.shape[0]))
    for a in range(cost_a.shape[0]):
        for b in range(cost_b.shape[0]):
            uncovered = np.float32(0.0)
            for p in range(cover_a.shape[1]):
                uncovered += min(cover_a[a, p], cover_b[b, p])
            total[a, b] = cost_a[a] + cost_b[b] + weight * uncovered
    return total


@njit(cache=True)
def best_pairs(total, centres_a, centres_b, count, apart):
    """Find the best pairs (n, 2) that differ from each other and from the last pair, the current limbs.

    Pairs differ if some ball of either limb is at least ``apart`` from its counterpart.
    """
    taken = np.empty((count, 2), np.int64)
    left = total.copy()
    left[-1, -1] = np.inf
    for n in range(count):
        least, best_a, best_b = np.inf, 0, 0
        for a in range(left.shape[0]):
            for b in range(left.shape[1]):
                if left[a, b] < least:
                    least, best_a, best_b = left[a, b], a, b
        if least == np.inf:
            return taken[:n]
        taken[n, 0], taken[n, 1] = best_a, best_b
        for a in range(left.shape[0]):
            if _gap(centres_a[a], centres_a[best_a]) < apart:
                for b in range(left.shape[1]):
                    if _gap(centres_b[b], centres_b[best_b]) < apart:
                        left[a, b] = np.inf
    return taken


@njit(cache=True)
def _gap(one, other):
    """Compute the greatest distance between corresponding balls of two limbs."""
    most = 0.0
    for s in range(one.shape[0]):
        d = 0.0
        for a in range(3):
            d += (one[s, a] - other[s, a]) ** 2
        most = max(most, d)
    return np.sqrt(most)
