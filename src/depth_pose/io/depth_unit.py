"""The unit of depth values, and detection of streams in another unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LEAST_MEDIAN_M, MOST_MEDIAN_M = 0.1, 10.0
"""Range of the median depth of indoor sensors, metres; an image outside it has another unit. Set by hand."""

INTEGER_UNIT_M = 0.001
"""Unit of integer depth images, metres: REP 118."""

_FRAMES = 30
"""Number of frames with depth that are checked in a stream: one second of most sensors. Set by hand."""

_FEWEST_LIVE = 10
"""Number of frames with depth after which a live stream is judged. Set by hand."""

_STEP = 8
"""Rows and columns between the pixels whose median is taken."""

_UNITS_M = (0.001, 0.0001, 0.00025, 0.01, 1.0)
"""Units in use, metres, the most frequent first."""

_PROBABLE_M = (0.4, 8.0)
"""Range of median depths for which a unit is proposed, metres. Set by hand."""


def unit_of(encoding: str) -> float:
    """Return the unit of an image's encoding, metres: that of REP 118."""
    return 1.0 if encoding == "32FC1" else INTEGER_UNIT_M


def in_metres(pixels: NDArray[np.generic], unit_m: float) -> NDArray[np.float32]:
    """Return depths in metres, C-contiguous float32.

    Millimetres are divided by 1000, which rounds as metres in a file do: equal depths have equal bits.
    """
    depth: NDArray[np.float32] = pixels.astype(np.float32, order="C")
    if unit_m == INTEGER_UNIT_M:
        depth /= np.float32(1000.0)
    elif unit_m != 1.0:
        depth *= np.float32(unit_m)
    return depth


def median_depth(depth: NDArray[np.floating]) -> float | None:
    """Return the median of the valid depths; None where there are none."""
    valid = depth[np.isfinite(depth) & (depth > 0)]
    return float(np.median(valid)) if valid.size else None


def is_indoors(median_m: float) -> bool:
    """Whether a sensor indoors may see this median depth, metres."""
    return LEAST_MEDIAN_M <= median_m <= MOST_MEDIAN_M


class UnitWatch:
    """Checks the first frames of a stream for depths that look like another unit.

    Parameters
    ----------
    setting : str
        The option or parameter that sets the unit.
    """

    def __init__(self, setting: str) -> None:
        self._setting = setting
        self._medians: list[float] = []
        self._unit_m = 1.0

    @property
    def is_decided(self) -> bool:
        """Whether enough frames were seen to judge a live stream."""
        return len(self._medians) >= _FEWEST_LIVE

    def look(self, depth: NDArray[np.float32], unit_m: float) -> None:
        """Add a frame.

        Parameters
        ----------
        depth : (H, W) float32
            Metres, by the unit assumed.
        unit_m : float
            That unit, metres.
        """
        if len(self._medians) >= _FRAMES:
            return
        median = median_depth(depth[::_STEP, ::_STEP])
        if median is not None:
            self._medians.append(median)
            self._unit_m = unit_m

    @property
    def doubt(self) -> str:
        """Reason why the depths look like another unit, and the option to set; empty if they do not."""
        doubtful = [median for median in self._medians if not is_indoors(median)]
        if 2 * len(doubtful) <= len(self._medians):
            return ""
        median = float(np.median(doubtful))
        return (
            f"the depths look like another unit: taken as {self._unit_m:g} m, their median is "
            f"{median:.4g} m, which no sensor sees indoors; {self._setting} sets the metres per unit"
            f"{self._proposal(median)}"
        )

    def _proposal(self, median_m: float) -> str:
        low, high = _PROBABLE_M
        for unit in _UNITS_M:
            if low <= median_m / self._unit_m * unit <= high:
                return f", here perhaps {unit:g}"
        return ""
