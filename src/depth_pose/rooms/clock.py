r"""Estimate a camera's clock offset from people who walk.

A camera whose stamps are too large by :math:`o` shows somebody with velocity :math:`v` at
:math:`d = -v\,o` from where the others see them. Least squares over many sightings gives
:math:`o = -\sum v \cdot d / \sum v \cdot v`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_WINDOW_S = 20.0
"""Time constant (s) over which sightings are remembered; set by hand."""

CORRELATED_S = 0.5
"""Correlation time (s) of the errors of sightings; set by hand."""

SLOW_M_S = 0.3
"""Minimum speed (m/s) of a person whose sighting is used; set by hand."""

ENOUGH_S = 5.0
"""Minimum time (s) for which people must have walked; set by hand."""


class ClockOffset:
    """Running estimate of a camera's clock offset."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all sightings."""
        self._vv = self._vd = self._dd = self._walked_s = 0.0

    def add(self, difference: NDArray[np.float64], velocity: NDArray[np.float64], passed_s: float) -> None:
        """Add a sighting.

        Parameters
        ----------
        difference : (3,) float64
            Position of the person by this camera minus that by the others, metres.
        velocity : (3,) float64
            The person's, m/s.
        passed_s : float
            Seconds since the last sighting.
        """
        weight = min(passed_s, CORRELATED_S)
        v, d = velocity[:2], difference[:2]
        if weight <= 0.0 or math.hypot(*v.tolist()) < SLOW_M_S:
            return
        kept = math.exp(-weight / _WINDOW_S)
        self._vv = kept * self._vv + weight * float(v @ v)
        self._vd = kept * self._vd + weight * float(v @ d)
        self._dd = kept * self._dd + weight * float(d @ d)
        self._walked_s = kept * self._walked_s + weight

    @property
    def offset_s(self) -> float:
        """Offset by which the camera's stamps are too large, seconds; 0 before enough is known."""
        return -self._vd / self._vv if self._walked_s >= ENOUGH_S else 0.0

    @property
    def deviation_s(self) -> float:
        """Standard deviation of the offset, seconds; infinite before enough is known."""
        if self._walked_s < ENOUGH_S:
            return math.inf
        rest = max(self._dd - self._vd**2 / self._vv, 0.0) / self._walked_s  # of both directions, m^2
        return math.sqrt(0.5 * rest * CORRELATED_S / self._vv)
