"""Kernels of the cloth simulation in `depth_pose.sim.clothing`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.kernels import njit

FLOOR_M = 0.01
"""No particle sinks below this height, metres."""


class Cloth(NamedTuple):
    """Particles (P, 3) ``now`` and one step ``before``, metres; ``links`` (L, 2) are held at ``lengths``."""

    now: NDArray[np.float64]
    before: NDArray[np.float64]
    links: NDArray[np.int64]
    lengths: NDArray[np.float64]


class Capsules(NamedTuple):
    """Capsules that push particles out: ``ends`` (C, 2, 3) with ``radii`` (C, 2) at them, metres."""

    ends: NDArray[np.float64]
    radii: NDArray[np.float64]


@njit(cache=True)
def step_cloth(cloth, pins, capsules, gravity_step, damping, rounds):
    """Run one step of position-based dynamics.

    ``pins`` (K, 3) are the first K particles' places.
    """
    now, before, links, lengths = cloth
    n, fixed = now.shape[0], pins.shape[0]
    for i in range(fixed, n):
        for k in range(3):
            speed = (now[i, k] - before[i, k]) * damping
            before[i, k] = now[i, k]
            now[i, k] += speed
        now[i, 1] -= gravity_step
    for i in range(fixed):
        for k in range(3):
            before[i, k] = now[i, k]
            now[i, k] = pins[i, k]
    for _ in range(rounds):
        for m in range(links.shape[0]):
            a, b = links[m, 0], links[m, 1]
            dx, dy, dz = now[b, 0] - now[a, 0], now[b, 1] - now[a, 1], now[b, 2] - now[a, 2]
            far = np.sqrt(dx * dx + dy * dy + dz * dz)
            wa, wb = 1.0 if a >= fixed else 0.0, 1.0 if b >= fixed else 0.0
            if wa + wb == 0.0 or far < 1e-9:
                continue
            pull = (far - lengths[m]) / far / (wa + wb)
            now[a, 0] += wa * pull * dx
            now[a, 1] += wa * pull * dy
            now[a, 2] += wa * pull * dz
            now[b, 0] -= wb * pull * dx
            now[b, 1] -= wb * pull * dy
            now[b, 2] -= wb * pull * dz
        _push_out(now, fixed, capsules)


@njit(cache=True)
def _push_out(now, fixed, capsules):
    ends, radii = capsules
    for c in range(ends.shape[0]):
        p, q = ends[c, 0], ends[c, 1]
        ex, ey, ez = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        size = max(ex * ex + ey * ey + ez * ez, 1e-12)
        for i in range(fixed, now.shape[0]):
            dx, dy, dz = now[i, 0] - p[0], now[i, 1] - p[1], now[i, 2] - p[2]
            s = min(max((dx * ex + dy * ey + dz * ez) / size, 0.0), 1.0)
            dx, dy, dz = dx - s * ex, dy - s * ey, dz - s * ez
            r = radii[c, 0] + s * (radii[c, 1] - radii[c, 0])
            far = np.sqrt(dx * dx + dy * dy + dz * dz)
            if 1e-9 < far < r:
                grow = r / far - 1.0
                now[i, 0] += grow * dx
                now[i, 1] += grow * dy
                now[i, 2] += grow * dz
    for i in range(fixed, now.shape[0]):
        now[i, 1] = max(now[i, 1], FLOOR_M)
