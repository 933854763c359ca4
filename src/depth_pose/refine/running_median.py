"""Weighted running medians with exponential forgetting, from histograms of equal steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.track.state import Histogram

Array = NDArray[np.float64]


class Bins(NamedTuple):
    """Bins of the histograms of ``rows`` values a frame: start, width, number; the outer bins are open."""

    rows: int
    first: float
    step: float
    steps: int

    def empty(self) -> Histogram:
        """Return a histogram without counts."""
        return Histogram(np.zeros((self.rows, self.steps)), np.zeros(self.rows))

    def add(self, histogram: Histogram, values: Array, weights: Array) -> Histogram:
        """Return the histogram with a frame's values and weights, (rows,) each."""
        bins = ((values - self.first) / self.step).astype(np.int64)
        bins = np.minimum(np.maximum(bins, 0), self.steps - 1)
        counts = histogram.counts.copy()
        counts[np.arange(self.rows), bins] += weights
        return Histogram(counts, histogram.total + weights)

    def medians(self, histogram: Histogram) -> Array:
        """Return the medians, (rows,), interpolated in their bins; rows without weight are undefined."""
        up = np.cumsum(histogram.counts, axis=1)
        half = 0.5 * up[:, -1]
        step, rows = np.argmax(up >= half[:, None], axis=1), np.arange(self.rows)
        own = histogram.counts[rows, step]
        inside = (half - up[rows, step] + own) / np.maximum(own, 1e-12)
        return np.asarray(self.first + self.step * (step + inside))


def forget(histogram: Histogram, kept: float) -> Histogram:
    """Return the histogram with earlier frames decayed to this share."""
    return Histogram(histogram.counts * kept, histogram.total * kept)
