"""Low-pass filter on the joints (Sec. 6) that follows fast motion closely.

The One-Euro filter (G. Casiez, N. Roussel, D. Vogel, *1 Euro filter*, CHI 2012): a first-order low-pass whose
cut-off frequency rises with speed, so that joints at rest do not jitter and moving joints do not lag.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SmoothConfig
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import lengths_of
from depth_pose.core.skeleton import Tracking
from depth_pose.track.state import FilterState

SPEED_CUTOFF_HZ = 4.0
"""Cut-off frequency (Hz) of the filter on the speed; accuracy is flat between 2 and 8."""

MOTION_CUTOFF_HZ = 6.0
"""Cut-off frequency (Hz) of the published velocities; chosen on development clips of 1.5 to 20."""


def low_pass(
    state: FilterState, positions: NDArray[np.float64], stamp_ns: int, config: SmoothConfig
) -> FilterState:
    """Filter one frame's joints, each with its own speed.

    Parameters
    ----------
    state : FilterState
        Of the frame before; the default for the first one.
    positions : (19, 3) float64
        Metres.
    stamp_ns : int
        The filter starts anew where it does not increase.
    config : SmoothConfig

    Returns
    -------
    FilterState
        Its ``positions`` are the filtered ones.
    """
    if state.stamp_ns is None or stamp_ns <= state.stamp_ns:
        return FilterState(stamp_ns, positions, np.zeros_like(positions), np.zeros_like(positions))
    dt = (stamp_ns - state.stamp_ns) * 1e-9
    share = _share(SPEED_CUTOFF_HZ, dt)
    velocity = state.velocity + share * ((positions - state.positions) / dt - state.velocity)
    cutoff = config.min_cutoff + config.beta * lengths_of(velocity)
    filtered = positions
    if config.enabled:
        filtered = state.positions + _share(cutoff, dt)[:, None] * (positions - state.positions)
    share = _share(MOTION_CUTOFF_HZ, dt)
    motion = state.motion + share * ((filtered - state.positions) / dt - state.motion)
    return FilterState(stamp_ns, filtered, velocity, motion)


def with_motion(skeleton: Skeleton, before: FilterState, now: FilterState) -> Skeleton:
    """Return a skeleton with filtered positions, with velocities, and whether the person is new.

    Parameters
    ----------
    skeleton : Skeleton
    before, now : FilterState
        Of the frame before, and of the skeleton's.
    """
    is_new = before.stamp_ns is None
    return replace(
        skeleton,
        positions=now.positions,
        velocities=np.zeros((0, 3)) if is_new else now.motion,
        tracking=Tracking.NEW if is_new else Tracking.TRACKED,
    )


def _share(cutoff: Any, dt: float) -> Any:
    """Compute the weight of a new sample in a first-order low-pass."""
    return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff * dt))
