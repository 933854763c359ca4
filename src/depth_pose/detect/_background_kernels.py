"""Compiled loops of the still background, for `depth_pose.detect.background`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from depth_pose.core.kernels import njit


class BackgroundLimits(NamedTuple):
    """Limits of `StillBackground`.

    Attributes
    ----------
    near_m, rise : float
        A change of depth above ``near_m + rise z^2`` is no noise, metres.
    least_share : float
        Share of the pixels that must be known to judge whether the camera has moved.
    most_farther : float
        Share of the known pixels that may show something farther while it stands still.
    most_shift : float
        Largest median change while it stands still, in units of the change that is no noise.
    """

    near_m: float
    rise: float
    least_share: float
    most_farther: float
    most_shift: float


@njit(cache=True)
def has_moved(depth, background, limits):
    """Check whether an image shows another view than the background."""
    known, farther, nearer_half, farther_half = 0, 0, 0, 0
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            z, b = depth[i, j], background[i, j]
            if z <= 0.0 or b <= 0.0:
                continue
            known += 1
            step = (z - b) / (limits.near_m + limits.rise * b * b)
            farther += step > 1.0
            nearer_half += step < -limits.most_shift
            farther_half += step > limits.most_shift
    if known < limits.least_share * depth.size:
        return False
    most = max(nearer_half, farther_half)
    return farther > limits.most_farther * known or 2 * most > known


@njit(cache=True)
def renew(depth, background, since_ns, stamp_ns, settles_ns, limits):
    """Add an image to the background: what is farther at once, what is nearer once it has stayed."""
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            z, b = depth[i, j], background[i, j]
            if z <= 0.0:
                continue
            least = np.float32(limits.near_m + limits.rise * b * b)
            if b <= 0.0 or z > b + least:
                background[i, j] = z
                since_ns[i, j] = stamp_ns
            elif z > b - least:
                background[i, j] = b + np.float32(0.1) * (z - b)
                since_ns[i, j] = stamp_ns
            elif stamp_ns - since_ns[i, j] > settles_ns:
                background[i, j] = z
                since_ns[i, j] = stamp_ns
