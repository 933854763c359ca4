"""Weighted running medians with exponential forgetting."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class RunningMedian:
    """Medians of several numbers, from histograms of equal steps with interpolation.

    Parameters
    ----------
    rows : int
        Numbers per frame.
    first, step : float
        Start and step of the histogram.
    steps : int
        Number of bins; values outside count in the first or last bin.

    Attributes
    ----------
    total : (rows,) float64
        Sums of weights.
    """

    def __init__(self, rows: int, first: float, step: float, steps: int) -> None:
        self._first, self._step = first, step
        self._counts = np.zeros((rows, steps))
        self.total = np.zeros(rows)
        self._medians: Array | None = None

    def forget(self, kept: float) -> None:
        """Decay earlier frames to this share."""
        self._counts *= kept
        self.total *= kept

    def add(self, values: Array, weights: Array) -> None:
        """Add a frame's values and weights, (rows,) each."""
        steps = ((values - self._first) / self._step).astype(np.int64)
        self._counts[np.arange(len(steps)), np.clip(steps, 0, self._counts.shape[1] - 1)] += weights
        self.total += weights
        self._medians = None

    def medians(self) -> Array:
        """Return the medians, (rows,); rows without weight are undefined."""
        if self._medians is None:
            up = np.cumsum(self._counts, axis=1)
            half = 0.5 * up[:, -1]
            step, rows = np.argmax(up >= half[:, None], axis=1), np.arange(len(up))
            own = self._counts[rows, step]
            inside = (half - up[rows, step] + own) / np.maximum(own, 1e-12)
            self._medians = self._first + self._step * (step + inside)
        return self._medians
