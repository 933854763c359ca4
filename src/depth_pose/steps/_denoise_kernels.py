"""Compiled loops of the modified LOP; `depth_pose.steps.denoise` gives the equations."""

from __future__ import annotations

import numpy as np
from numba import njit

STEPS = 1024
_TABLE = np.exp(-16.0 * np.linspace(0.0, 0.65**2 * 3.0, STEPS + 1))
"""theta as a function of r^2 / h^2, up to the corner of the support's cube."""


@njit(cache=True, fastmath=True)
def theta(ratio):
    """``exp(-16 r^2 / h^2)`` of ``r^2 / h^2``, from a table with linear interpolation."""
    place = ratio * (STEPS / (0.65 * 0.65 * 3.0))
    if place >= STEPS:
        return 0.0
    k = int(place)
    return _TABLE[k] + (place - k) * (_TABLE[k + 1] - _TABLE[k])


@njit(cache=True)
def window(cut, fx, fy, z):
    """Half-sizes of the support in pixels, and the step at which about 16 x 16 of them are read."""
    step = max(1, int(cut * fx / z) // 8)
    return (int(cut * fy / z) // step + 1) * step, (int(cut * fx / z) // step + 1) * step, step


@njit(cache=True, fastmath=True)
def project_first(depth, fx, fy, cx, cy, h):
    """Eq. 1: weighted mean depth of the neighbours within the support."""
    rows, cols = depth.shape
    out = np.zeros_like(depth)
    cut = 0.65 * h  # theta(0.65 h) = exp(-6.8)
    inverse = 1.0 / (h * h)
    for i in range(rows):
        for j in range(cols):
            z = depth[i, j]
            if z <= 0.0:
                continue
            x, y = (j - cx) / fx * z, (i - cy) / fy * z
            reach_y, reach_x, step = window(cut, fx, fy, z)
            total, weight = 0.0, 0.0
            for a in range(i - reach_y, i + reach_y + 1, step):
                for b in range(j - reach_x, j + reach_x + 1, step):
                    if a < 0 or b < 0 or a >= rows or b >= cols:
                        continue
                    zs = depth[a, b]
                    if zs <= 0.0 or abs(zs - z) > cut:
                        continue
                    dx, dy, dz = (b - cx) / fx * zs - x, (a - cy) / fy * zs - y, zs - z
                    w = theta(inverse * (dx * dx + dy * dy + dz * dz))
                    total += w * zs
                    weight += w
            out[i, j] = total / weight
    return out


@njit(cache=True, fastmath=True)
def project_next(original, depth, fx, fy, cx, cy, h, mu):
    """Eqs. 3 and 5: attraction by the original points, repulsion by the projected ones."""
    rows, cols = depth.shape
    out = np.zeros_like(depth)
    cut = 0.65 * h
    inverse = 1.0 / (h * h)
    for i in range(rows):
        for j in range(cols):
            z = depth[i, j]
            if z <= 0.0:
                continue
            z0 = original[i, j]
            rx, ry = (j - cx) / fx, (i - cy) / fy
            reach_y, reach_x, step = window(cut, fx, fy, z)
            total, weight, push, push_weight = 0.0, 0.0, 0.0, 0.0
            for a in range(i - reach_y, i + reach_y + 1, step):
                for b in range(j - reach_x, j + reach_x + 1, step):
                    if a < 0 or b < 0 or a >= rows or b >= cols:
                        continue
                    zs = depth[a, b]
                    if zs <= 0.0 or abs(zs - z) > cut:
                        continue
                    sx, sy = (b - cx) / fx, (a - cy) / fy
                    # alpha: distance of the projected neighbour from the original point
                    dx, dy, dz = sx * zs - rx * z0, sy * zs - ry * z0, zs - z0
                    r2 = max(dx * dx + dy * dy + dz * dz, 1e-6)
                    w = theta(inverse * r2) / np.sqrt(r2)
                    total += w * original[a, b]
                    weight += w
                    if a == i and b == j:
                        continue
                    # beta, with |d eta / d r| = r^2 for eta(r) = r^3 / 3
                    dx, dy, dz = sx * zs - rx * z, sy * zs - ry * z, zs - z
                    r2 = max(dx * dx + dy * dy + dz * dz, 1e-6)
                    w = theta(inverse * r2) * np.sqrt(r2)
                    push += w * (z - zs)
                    push_weight += w
            out[i, j] = total / weight
            if push_weight > 0.0:
                out[i, j] += mu * push / push_weight
    return out


@njit(cache=True)
def drop_outliers(depth, fx, fy, cx, cy, distance):
    """Drop points whose nearest neighbour is farther than ``distance``."""
    rows, cols = depth.shape
    out = depth.copy()
    for i in range(rows):
        for j in range(cols):
            z = depth[i, j]
            if z <= 0.0:
                continue
            x, y = (j - cx) / fx * z, (i - cy) / fy * z
            reach = int(distance * fx / z) + 1
            near = False
            for a in range(max(0, i - reach), min(rows, i + reach + 1)):
                for b in range(max(0, j - reach), min(cols, j + reach + 1)):
                    zs = depth[a, b]
                    if zs <= 0.0 or (a == i and b == j):
                        continue
                    dx, dy, dz = (b - cx) / fx * zs - x, (a - cy) / fy * zs - y, zs - z
                    if dx * dx + dy * dy + dz * dz < distance * distance:
                        near = True
                        break
                if near:
                    break
            if not near:
                out[i, j] = 0.0
    return out
