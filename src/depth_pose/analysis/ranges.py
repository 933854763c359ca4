"""Ranges of motion: the least and the greatest of each joint angle over a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from depth_pose.analysis.measures import Measure
from depth_pose.analysis.motion import Motion
from depth_pose.body.angle_definitions import AGAINST_VERTICAL, JOINT_ANGLES

GROUP = "range of motion"

_EDGES = (2.0, 98.0)
"""Percentiles that stand for the least and the greatest. Set by hand: single frames may be wrong."""
LEAST_FRAMES = 20
"""Minimum number of frames in which an angle is measured. Set by hand."""


@dataclass(frozen=True)
class Range:
    """The range of one joint angle.

    Attributes
    ----------
    angle : str
        One of `JOINT_ANGLES`.
    low, high, deviation : float
        Degrees; NaN where it is not measured. The deviation is that of each end.
    frames : int
        Frames in which the angle is measured.
    reason : str
        Why it is not known; empty where it is.
    """

    angle: str
    low: float
    high: float
    deviation: float
    frames: int
    reason: str = ""


def ranges_of_motion(motion: Motion, has_floor: bool = True) -> tuple[Range, ...]:
    """Return the range of each joint angle, in the order of `JOINT_ANGLES`."""
    out = []
    for i, name in enumerate(JOINT_ANGLES):
        known = np.isfinite(motion.angles[:, i]) & motion.present
        count = int(known.sum())
        if count < LEAST_FRAMES:
            out.append(Range(name, np.nan, np.nan, np.nan, count, _reason(name, count, has_floor)))
            continue
        values = motion.angles[known, i]
        if np.ptp(values) > 180.0:  # a direction that goes around
            values = np.degrees(np.unwrap(np.radians(values)))
        low, high = np.percentile(values, _EDGES)
        deviation = float(np.median(motion.angle_deviations[known, i]))
        out.append(Range(name, float(low), float(high), deviation, count))
    return tuple(out)


def _reason(name: str, frames: int, has_floor: bool) -> str:
    if name in AGAINST_VERTICAL and not has_floor:
        return "it needs the floor"
    if "rotation" in name and not name.startswith("trunk"):
        return f"a straight limb does not show its rotation; measured in {frames} frames"
    if name.endswith("plane"):
        return f"a hanging arm has no plane of elevation; measured in {frames} frames"
    return f"its joints are too unsure; measured in {frames} frames"


def range_measures(ranges: tuple[Range, ...]) -> tuple[Measure, ...]:
    """Return the ranges as measures: their least, their greatest, and the difference."""
    out = []
    for r in ranges:
        side, _, plain = (
            r.angle.partition("_") if r.angle.startswith(("left_", "right_")) else ("", "", r.angle)
        )
        name = plain.replace("_", " ")
        for part, value, factor in (
            ("least", r.low, 1.0),
            ("greatest", r.high, 1.0),
            ("range", r.high - r.low, np.sqrt(2.0)),
        ):
            deviation = factor * r.deviation
            out.append(
                Measure(
                    GROUP,
                    f"{name}, {part}",
                    side,
                    value,
                    float(deviation),
                    "deg",
                    r.frames,
                    "frames",
                    r.frames,
                    r.reason,
                )
            )
    return tuple(out)
