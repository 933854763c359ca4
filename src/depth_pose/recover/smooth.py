"""Low-pass filter on the joints (Sec. 6) that follows fast motion closely.

The One-Euro filter (G. Casiez, N. Roussel, D. Vogel, *1 Euro filter*, CHI 2012): a first-order low-pass whose
cut-off frequency rises with speed, so that joints at rest do not jitter and moving joints do not lag.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SmoothConfig

SPEED_CUTOFF_HZ = 4.0
"""Cut-off frequency (Hz) of the filter on the speed; set by hand."""


class JointFilter:
    """Filters joint positions, each joint with its own speed."""

    def __init__(self, config: SmoothConfig) -> None:
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Reset the filter."""
        self._stamp_ns: int | None = None

    def filter(self, positions: NDArray[np.float64], stamp_ns: int) -> NDArray[np.float64]:
        """Filter one frame's joints.

        Parameters
        ----------
        positions : (19, 3) float64
            Metres.
        stamp_ns : int
            Must increase between calls until `reset`.

        Returns
        -------
        (19, 3) float64
        """
        if not self.config.enabled:
            return positions
        if self._stamp_ns is None or stamp_ns <= self._stamp_ns:
            self._stamp_ns, self._last = stamp_ns, positions
            self._velocity = np.zeros_like(positions)
            return positions
        dt = (stamp_ns - self._stamp_ns) * 1e-9
        share = _share(np.full(1, SPEED_CUTOFF_HZ), dt)
        self._velocity = self._velocity + share * ((positions - self._last) / dt - self._velocity)
        speed = np.linalg.norm(self._velocity, axis=1)
        cutoff = self.config.min_cutoff + self.config.beta * speed
        self._last = self._last + _share(cutoff, dt)[:, None] * (positions - self._last)
        self._stamp_ns = stamp_ns
        return self._last


def _share(cutoff: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
    """Compute the weight of a new sample in a first-order low-pass."""
    return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff * dt))
