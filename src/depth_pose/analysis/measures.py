"""Measures: numbers with a unit, an uncertainty and a count, or a reason for none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Measure:
    """One number of a report.

    Attributes
    ----------
    group : str
        Section of the report: gait, rising, sway, range of motion.
    name : str
        In plain words.
    side : str
        ``left``, ``right``, or empty for both or neither.
    value : float
        NaN where the recording does not tell; `reason` says why.
    deviation : float
        Standard deviation of ``value``; NaN where it has none.
    unit : str
    count : int
        Steps, strides, rises or frames that it is the mean of; `of` says which.
    of : str
    frames : int
        Frames of the recording that were used.
    reason : str
        Why there is no value; empty where there is one.
    """

    group: str
    name: str
    side: str
    value: float
    deviation: float
    unit: str
    count: int
    of: str
    frames: int
    reason: str = ""

    @property
    def is_known(self) -> bool:
        """Whether there is a value."""
        return not self.reason


@dataclass(frozen=True)
class Mean:
    """The mean of some values, its standard deviation, and how many they were."""

    value: float
    deviation: float
    count: int


def mean_of(values: Array, each: float = 0.0, common: float = 0.0) -> Mean:
    """Average values whose own error is known.

    The deviation of the mean is that of their scatter, but not less than that of the error of each, over the
    square root of their number, and an error that all share.

    Parameters
    ----------
    values : (N,)
        NaN are left out.
    each : float
        Standard deviation of the error of one value.
    common : float
        Standard deviation of the error that all of them share.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return Mean(float("nan"), float("nan"), 0)
    scatter = float(known.std(ddof=1)) if len(known) > 1 else 0.0
    deviation = float(np.hypot(max(scatter, each) / np.sqrt(len(known)), common))
    return Mean(float(known.mean()), deviation, len(known))


def too_slow(rate_hz: float, least_hz: float) -> str:
    """Return the reason for refusing a recording of too few frames a second; empty where there are enough."""
    if rate_hz >= 0.95 * least_hz:
        return ""
    return f"{rate_hz:.1f} frames a second are too few; {least_hz:.0f} are needed"


def refused(group: str, names: dict[str, str], reason: str) -> tuple[Measure, ...]:
    """Return measures without values for a reason; ``names`` has their units."""
    nan = float("nan")
    return tuple(Measure(group, name, "", nan, nan, unit, 0, "", 0, reason) for name, unit in names.items())
