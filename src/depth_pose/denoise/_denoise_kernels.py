"""Compiled loops of the modified LOP; see `depth_pose.denoise.denoise` for the equations."""

from __future__ import annotations

import numpy as np

from depth_pose.core._camera_kernels import ray
from depth_pose.core._fast_exp import falling_exp
from depth_pose.core.kernels import njit

CUT = 0.6
"""Neighbours farther than this share of the support h are ignored: theta(0.6 h) = exp(-5.8)."""

_MOST = np.float32(16.0 * CUT * CUT)
"""`CUT` as an argument of `theta`."""

_LANES = 8
"""A row of neighbours is padded with `_FAR_AWAY` to a multiple of this number."""

_FAR_AWAY = np.float32(1e4)
"""Coordinate of the padding, in units of h / 4, too far away to get any weight."""

_READ = 4
"""Approximate number of neighbours read on each side of a pixel; more have almost no effect (see the tests).
With 3 points lie 9.9 mm off the surface, with 4 or 5 8.1."""

_LEAST_SQUARE = 1e-6
"""Least squared distance (m^2) of two points, one millimetre, which keeps weights finite."""


@njit(cache=True, fastmath=True, forceinline=True)
def theta(square):
    """Compute ``exp(-16 r^2 / h^2)`` from ``16 r^2 / h^2``; 0 beyond `CUT`."""
    w = falling_exp(min(square, _MOST))
    return w if square < _MOST else np.float32(0.0)


@njit(cache=True)
def window(h, camera, z):
    """Compute the half-sizes of the support in pixels, rows and columns."""
    return int(CUT * h * camera.fy / z) + 1, int(CUT * h * camera.fx / z) + 1


@njit(cache=True)
def step_of(depth, h, fx):
    """Compute the step at which about 8 x 8 neighbours of a pixel are read, at the mean depth."""
    total, count = 0.0, 0
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            if depth[i, j] > 0.0:
                total += depth[i, j]
                count += 1
    return max(1, int(CUT * h * fx * count / total) // _READ) if count > 0 else 1


@njit(cache=True, fastmath=True)
def project_first(depth, camera, h, step):
    """Ye et al. eqs. 1 and 2: compute the weighted mean depth of every ``step``-th neighbour in the support.

    The points, in units of h / 4, lie in flat arrays. Columns ``step`` apart lie side by side there with
    padding around them, so that the inner loop, which dominates the run time, is vectorised.
    """
    rows, cols = depth.shape
    out = np.zeros_like(depth)
    nearest = np.inf
    for i in range(rows):
        for j in range(cols):
            if depth[i, j] > 0.0:
                nearest = min(nearest, depth[i, j])
    if nearest == np.inf:
        return out
    pad = window(h, camera, nearest)[1] // step + 1 + _LANES
    part = (cols - 1) // step + 1 + 2 * pad  # columns with the same remainder
    width = step * part
    x, y, z = (
        np.empty(rows * width, np.float32),
        np.empty(rows * width, np.float32),
        np.empty(rows * width, np.float32),
    )
    x[:] = y[:] = z[:] = _FAR_AWAY
    first, last = np.full(rows, cols), np.full(rows, -1)
    unit = 4.0 / h
    for i in range(rows):
        for j in range(cols):
            if depth[i, j] > 0.0:
                k = i * width + j % step * part + pad + j // step
                away = unit * depth[i, j]
                rx, ry = ray(camera, j, i)
                x[k], y[k], z[k] = rx * away, ry * away, away
                first[i], last[i] = min(first[i], j), j
    for i in range(rows):
        for j in range(first[i], last[i] + 1):
            if depth[i, j] <= 0.0:
                continue
            reach_y, reach_x = window(h, camera, depth[i, j])
            wide = reach_x // step
            lanes = np.uint64((2 * wide + _LANES) // _LANES * _LANES)
            own = i * width + j % step * part + pad + j // step
            x0, y0, z0 = x[own], y[own], z[own]
            # Ye et al. eq. 1: the mean of the neighbours' depths, weighted by theta of their distance
            total, weight = np.float32(0.0), np.float32(0.0)
            for down in range(-(reach_y // step) * step, reach_y + 1, step):
                a = i + down
                if a < 0 or a >= rows or last[a] < j - reach_x or first[a] > j + reach_x:
                    continue
                start = np.uint64(own + down * width - wide)
                for k in range(lanes):
                    dx, dy, dz = x[start + k] - x0, y[start + k] - y0, z[start + k] - z0
                    w = theta(dx * dx + dy * dy + dz * dz)
                    total += w * dz
                    weight += w
            out[i, j] = depth[i, j] + total / (unit * weight)
    return out


@njit(cache=True, fastmath=True)
def project_next(original, depth, camera, h, mu, step):
    """Ye et al. eqs. 3 to 5: attraction by the original points, repulsion by the projected ones."""
    rows, cols = depth.shape
    out = np.zeros_like(depth)
    inverse = 16.0 / (h * h)
    for i in range(rows):
        for j in range(cols):
            z = depth[i, j]
            if z <= 0.0:
                continue
            z0 = original[i, j]
            rx, ry = ray(camera, j, i)
            reach_y, reach_x = window(h, camera, z)
            reach_y, reach_x = (reach_y // step + 1) * step, (reach_x // step + 1) * step
            total, weight, push, push_weight = 0.0, 0.0, 0.0, 0.0
            for a in range(i - reach_y, i + reach_y + 1, step):
                for b in range(j - reach_x, j + reach_x + 1, step):
                    if a < 0 or b < 0 or a >= rows or b >= cols:
                        continue
                    zs = depth[a, b]
                    if zs <= 0.0:
                        continue
                    # Ye et al. eq. 4: a projected point lies at its depth on its pixel's ray
                    sx, sy = ray(camera, b, a)
                    # Ye et al. eq. 5: alpha, distance of the projected neighbour from the original point
                    dx, dy, dz = sx * zs - rx * z0, sy * zs - ry * z0, zs - z0
                    r2 = max(dx * dx + dy * dy + dz * dz, _LEAST_SQUARE)
                    w = theta(np.float32(inverse * r2)) / np.sqrt(r2)
                    total += w * original[a, b]
                    weight += w
                    if a == i and b == j:
                        continue
                    # Ye et al. eq. 5: beta, with |d eta / d r| = r^2 for eta(r) = r^3 / 3
                    dx, dy, dz = sx * zs - rx * z, sy * zs - ry * z, zs - z
                    r2 = max(dx * dx + dy * dy + dz * dz, _LEAST_SQUARE)
                    w = theta(np.float32(inverse * r2)) * np.sqrt(r2)
                    push += w * (z - zs)
                    push_weight += w
            # Ye et al. eq. 3: attraction, and repulsion by the signed difference in z
            out[i, j] = total / weight
            if push_weight > 0.0:
                out[i, j] += mu * push / push_weight
    return out


@njit(cache=True)
def drop_outliers(depth, camera, distance):
    """Drop points whose nearest neighbour is farther than ``distance``."""
    rows, cols = depth.shape
    out = depth.copy()
    for i in range(rows):
        for j in range(cols):
            z = depth[i, j]
            if z <= 0.0:
                continue
            reach = int(distance * camera.fx / z) + 1
            is_alone = not has_near(depth, camera, distance, i, j, 1)  # few points are
            if is_alone and not has_near(depth, camera, distance, i, j, reach):
                out[i, j] = 0.0
    return out


@njit(cache=True)
def has_near(depth, camera, distance, i, j, reach):
    """Check whether a point within ``reach`` pixels lies within ``distance`` of the point at a pixel."""
    rows, cols = depth.shape
    z = depth[i, j]
    rx, ry = ray(camera, j, i)
    for a in range(max(0, i - reach), min(rows, i + reach + 1)):
        for b in range(max(0, j - reach), min(cols, j + reach + 1)):
            zs = depth[a, b]
            if zs <= 0.0 or (a == i and b == j):
                continue
            sx, sy = ray(camera, b, a)
            dx, dy, dz = sx * zs - rx * z, sy * zs - ry * z, zs - z
            if dx * dx + dy * dy + dz * dz < distance * distance:
                return True
    return False
