"""Rising from a chair and sitting down, as in tests of function.

The five-times-sit-to-stand test: M. Csuka and D. J. McCarty, *Simple method for measurement of lower
extremity muscle strength*, Am. J. Med. 78, 1985; the 30 s chair stand: C. J. Jones, R. E. Rikli and W. C.
Beam, Res. Q. Exerc. Sport 70, 1999. A rise is the way of the pelvis from `_LOW` to `_HIGH` of the height
between sitting and standing, as the leg's length tells them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from depth_pose.analysis.measures import Array, Measure, mean_of, refused, too_slow
from depth_pose.analysis.motion import Motion, runs

GROUP = "rising from a chair"

NAMES = {"rises": "", "time of a rise": "s", "time of sitting down": "s", "time of five rises": "s"}
"""Measures of rising and their units."""

_SIT, _STAND = 0.75, 0.92
"""Height of the pelvis above the floor as a share of its height on straight legs: below the first somebody
sits, above the second they stand. Set by hand: a usual seat is at half the height."""
_PELVIS_PER_LEG = 1.14
"""Height of the pelvis on straight legs per length from hip to ankle; measured on skinned bodies (1.12 to
1.16)."""
_LOW, _HIGH = 0.05, 0.95
"""Parts of the way from sitting to standing between which a rise is timed. Set by hand: beyond them the
pelvis hardly moves."""
_LEAST_RATE_HZ = 10.0
"""Minimum number of frames a second. Set by hand: a rise takes about a second."""
_LONGEST_S = 6.0
"""Maximum duration of a rise. Set by hand."""
_EVENT_S = 0.03
"""Standard deviation of the time of one of its ends: a frame at 30 frames a second."""


@dataclass(frozen=True)
class Rise:
    """One way from sitting to standing, or back.

    Attributes
    ----------
    begin, end : float
        Seconds.
    is_up : bool
    """

    begin: float
    end: float
    is_up: bool


@dataclass(frozen=True)
class Rising:
    """What is known of somebody's rising from a chair.

    Attributes
    ----------
    rises : tuple of Rise
    measures : tuple of Measure
    """

    rises: tuple[Rise, ...]
    measures: tuple[Measure, ...]


def pelvis_share(motion: Motion) -> Array:
    """Height of the pelvis above the floor as a share of its height on straight legs, (T,); NaN in gaps."""
    lengths = []
    for side in ("left", "right"):
        hip, knee, ankle = (motion.at(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
        lengths.append(np.linalg.norm(hip - knee, axis=1) + np.linalg.norm(knee - ankle, axis=1))
    return np.asarray(motion.at("pelvis")[:, 2] / (_PELVIS_PER_LEG * np.nanmedian(lengths)))


def analyse_rising(motion: Motion) -> Rising:
    """Find rises from a chair, count and time them."""
    if reason := too_slow(motion.rate_hz, _LEAST_RATE_HZ):
        return Rising((), refused(GROUP, NAMES, reason))
    share = pelvis_share(motion)
    with np.errstate(invalid="ignore"):
        state = np.where(share > _STAND, 1, np.where(share < _SIT, -1, 0))
    rests = [(a, b, 1) for a, b in runs(state == 1)] + [(a, b, -1) for a, b in runs(state == -1)]
    rests.sort()
    rises = []
    for (a, b, before), (c, d, after) in pairwise(rests):
        whole = motion.present[b - 1 : c + 1].all()
        if before != after and whole and motion.times[c] - motion.times[b - 1] < _LONGEST_S:
            rises.append(_timed(motion, share, (a, b), (c, d)))
    ups = [rise for rise in rises if rise.is_up]
    if not ups:
        return Rising(tuple(rises), refused(GROUP, NAMES, "nobody rises from a seat"))
    return Rising(tuple(rises), _measures(motion, rises))


def _timed(motion: Motion, share: Array, before: tuple[int, int], after: tuple[int, int]) -> Rise:
    """Find the ends of a rise between two rests: their levels, and the crossings of `_LOW` and `_HIGH`."""
    first, last = float(np.median(share[slice(*before)])), float(np.median(share[slice(*after)]))
    begin, end = (before[0] + before[1]) // 2, (after[0] + after[1]) // 2
    way = (share[begin : end + 1] - first) / (last - first)
    times = motion.times[begin : end + 1]
    leaves = int(np.flatnonzero(way < _LOW)[-1]) if (way < _LOW).any() else 0
    later = np.flatnonzero(way[leaves:] > _HIGH)
    arrives = leaves + int(later[0]) if len(later) else len(way) - 1
    return Rise(_crossing(times, way, leaves, _LOW), _crossing(times, way, arrives - 1, _HIGH), last > first)


def _crossing(times: Array, way: Array, i: int, level: float) -> float:
    """Time between two frames at which a level is crossed, seconds."""
    i = min(max(i, 0), len(way) - 2)
    step = way[i + 1] - way[i]
    part = float(np.clip((level - way[i]) / step, 0.0, 1.0)) if step > 0 else 0.0
    return float(times[i] + part * (times[i + 1] - times[i]))


def _measures(motion: Motion, rises: list[Rise]) -> tuple[Measure, ...]:
    frames = int(motion.present.sum())
    each = np.sqrt(2) * _EVENT_S
    ups = [rise for rise in rises if rise.is_up]
    downs = [rise for rise in rises if not rise.is_up]
    up = mean_of(np.array([rise.end - rise.begin for rise in ups]), each)
    out = [
        Measure(GROUP, "rises", "", float(len(ups)), 0.0, "", len(ups), "rises", frames),
        Measure(GROUP, "time of a rise", "", up.value, up.deviation, "s", up.count, "rises", frames),
    ]
    if downs:
        down = mean_of(np.array([rise.end - rise.begin for rise in downs]), each)
        value = (down.value, down.deviation, "s", down.count, "descents", frames)
        out.append(Measure(GROUP, "time of sitting down", "", *value))
    if len(ups) >= 5:
        total = ups[4].end - ups[0].begin
        out.append(Measure(GROUP, "time of five rises", "", total, each, "s", 5, "rises", frames))
    else:
        reason = f"{len(ups)} rises were seen; five are needed"
        out.append(Measure(GROUP, "time of five rises", "", np.nan, np.nan, "s", 0, "", 0, reason))
    return tuple(out)
