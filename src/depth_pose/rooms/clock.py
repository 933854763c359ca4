r"""Estimate a camera's clock offset from people who walk.

A camera whose stamps are too large by :math:`o` shows somebody with velocity :math:`v` at
:math:`d = b - v\,o` from where the others see them, with a constant :math:`b` of the rig's error. Least
squares over many sightings gives :math:`o`. Its deviation has two parts. The errors of sightings are
correlated, so theirs is the spread of the sums over seconds of walking (a cluster-robust variance). And the
filters of two suites hold their skeletons back by different ways, which looks like an offset: by at most
`HELD_BACK_M`, whatever the speed.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SmoothConfig
from depth_pose.rooms.walks import WalkSample

SLOW_M_S = 0.3
"""Minimum speed (m/s) of a person whose sighting is used; set by hand."""

ENOUGH_S = 5.0
"""Minimum time (s) for which people must have walked; set by hand."""

HELD_BACK_M = 1.0 / (2.0 * math.pi * SmoothConfig().beta)
"""Way (m) by which the low-pass filter holds a joint back at any speed: the speed over the angular cut-off
frequency that it adds."""

SURE = 3.0
"""Number of standard deviations by which an offset must exceed the least that is corrected."""

_BLOCK_S = 1.0
"""Time (s) of walking whose sum counts as one independent error: two correlation times."""

_BLOCKS = 24
"""Number of such times that are remembered; set by hand."""

_LEAST = 1e-9
"""Minimum of a sum of squares (m^2 s or m^2/s) that divides."""


@dataclass(frozen=True)
class OffsetEstimate:
    """A clock offset.

    Attributes
    ----------
    offset_s : float
        By which the camera's stamps are too large, seconds.
    deviation_s : float
        Standard deviation, seconds; infinite where too little is known.
    """

    offset_s: float = 0.0
    deviation_s: float = math.inf

    def exceeds(self, least_s: float) -> bool:
        """Whether the offset is larger than a limit (s) beyond doubt."""
        return abs(self.offset_s) - SURE * self.deviation_s > least_s


def sums_of(sample: WalkSample) -> NDArray[np.float64] | None:
    """Return a sample's sums (9,), weighted: 1, v (2), d (2), vv, vd, dd, speed; None if it is too slow."""
    v, d = sample.velocity, sample.difference
    speed = math.hypot(*v.tolist())
    if sample.weight_s <= 0.0 or speed < SLOW_M_S:
        return None
    return sample.weight_s * np.array([1.0, *v, *d, v @ v, v @ d, d @ d, speed])


def centred(sums: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return the centred sums of squares vv, vd, dd of sums (..., 9)."""
    count = np.maximum(sums[..., 0], _LEAST)
    v, d = sums[..., 1:3], sums[..., 3:5]
    vv = np.maximum(sums[..., 5] - (v * v).sum(axis=-1) / count, _LEAST)
    vd = sums[..., 6] - (v * d).sum(axis=-1) / count
    dd = np.maximum(sums[..., 7] - (d * d).sum(axis=-1) / count, 0.0)
    return vv, vd, dd


def estimate_offset(blocks: NDArray[np.float64]) -> OffsetEstimate:
    """Estimate the offset from sums (B, 9) whose errors are independent."""
    total = blocks.sum(axis=0)
    if len(blocks) < 3 or total[0] < ENOUGH_S:
        return OffsetEstimate()
    vv, vd, _ = (float(part) for part in centred(total))
    offset = -vd / vv
    v, d = total[1:3] / total[0], total[3:5] / total[0]
    count, sum_v, sum_d = blocks[:, 0], blocks[:, 1:3], blocks[:, 3:5]
    cross = blocks[:, 6] - sum_d @ v - sum_v @ d + count * (v @ d)
    square = blocks[:, 5] - 2.0 * sum_v @ v + count * (v @ v)
    scores = cross + offset * square
    chance = math.sqrt(float(scores @ scores) * len(blocks) / (len(blocks) - 2)) / vv
    return OffsetEstimate(offset, math.hypot(chance, HELD_BACK_M * float(total[8]) / vv))


class ClockOffset:
    """Running estimate of a camera's clock offset."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._blocks: deque[NDArray[np.float64]] = deque(maxlen=_BLOCKS)

    def add(self, sample: WalkSample) -> None:
        """Add a sample."""
        sums = sums_of(sample)
        if sums is None:
            return
        if self._blocks and self._blocks[-1][0] < _BLOCK_S:
            self._blocks[-1] = self._blocks[-1] + sums
        else:
            self._blocks.append(sums)

    @property
    def estimate(self) -> OffsetEstimate:
        """The offset, with its deviation."""
        return estimate_offset(np.array(self._blocks)) if self._blocks else OffsetEstimate()


def blocks_of(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add up sums (N, 9) of samples, in order, over `_BLOCK_S` of walking each; return (B, 9)."""
    walked = np.cumsum(sums[:, 0]) - sums[:, 0]
    numbers = (walked / _BLOCK_S).astype(int)
    return np.add.reduceat(sums, np.flatnonzero(np.diff(numbers, prepend=-1)))
