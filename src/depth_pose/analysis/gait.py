"""Figures of gait: speed, cadence, steps, phases and symmetry, each with its deviation.

**Symmetry**: R. O. Robinson, W. Herzog and B. M. Nigg, J. Manip. Physiol. Ther. 10, 1987: the difference of
left and right as a share of their mean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from depth_pose.analysis.measures import Array, Measure, mean_of, refused, too_slow
from depth_pose.analysis.motion import Motion
from depth_pose.analysis.steps import (
    LEAST_S,
    SIDES,
    Event,
    Step,
    Walk,
    find_walk,
    pelvis_path,
    steps_of,
    straight_parts,
)
from depth_pose.core.skeleton import JOINT_INDEX

GROUP = "gait"

_UNLIKE = 0.4
"""Maximum difference of a step's time from the median, as a share of it. Set by hand: a limp is less."""
_SCALE = 0.013
"""Deviation of speeds that all of a recording share, as a share of them; measured, as the next:
``python benchmarks/angles.py gait``."""
_STEP_OFF_M = 0.005
"""Deviation of the mean step length and width that all steps of a recording share, metres."""
_LEAST_RATE_HZ = 15.0
"""Minimum number of frames a second. Set by hand: a step has then seven or more."""
LEAST_STEPS = 4
"""Minimum number of steps for any number about gait: two of each foot."""
LEAST_SURE = 0.6
"""Minimum share of a walk's frames in which both ankles are sure. Set by hand."""
_EVENT_S = 0.02
"""Standard deviation of the time of an event: Zeni et al. 2008, and half a frame at 30 frames a second."""

NAMES = {
    "speed": "m/s",
    "cadence": "steps/min",
    "step length": "m",
    "step width": "m",
    "stride time": "s",
    "stance": "% of the stride",
    "swing": "% of the stride",
    "double support": "% of the stride",
    "symmetry of step length": "%",
    "symmetry of stance": "%",
}
"""Measures of gait and their units."""


@dataclass(frozen=True)
class Gait:
    """What is known of somebody's gait.

    Attributes
    ----------
    walks : tuple of Walk
    measures : tuple of Measure
    """

    walks: tuple[Walk, ...]
    measures: tuple[Measure, ...]


def analyse_gait(motion: Motion) -> Gait:
    """Find straight walks and their steps, and average them.

    Where there are too few frames a second, fewer than `LEAST_STEPS` steps, or the feet are too unsure, the
    measures say why.
    """
    if reason := too_slow(motion.rate_hz, _LEAST_RATE_HZ):
        return Gait((), refused(GROUP, NAMES, reason))
    parts = straight_parts(motion)
    if not parts:
        return Gait((), refused(GROUP, NAMES, f"nobody walks straight for {LEAST_S:.0f} s or more"))
    ankles = motion.is_sure("left_ankle", "right_ankle")
    seen = [part for part in parts if ankles[slice(*part)].mean() >= LEAST_SURE]
    if not seen:
        share = max(float(ankles[slice(*part)].mean()) for part in parts)
        reason = (
            f"both ankles are sure in at most {share:.0%} of a walk's frames; {LEAST_SURE:.0%} are needed"
        )
        return Gait((), refused(GROUP, NAMES, reason))
    walks = tuple(find_walk(motion, *part) for part in seen)
    steps = [step for walk in walks for step in steps_of(walk)]
    usual_s = float(np.median([step.seconds for step in steps])) if steps else 0.0
    steps = [step for step in steps if _is_usual(step.seconds, usual_s)]
    if len(steps) < LEAST_STEPS:
        reason = f"only {len(steps)} steps were seen whole; {LEAST_STEPS} are needed"
        return Gait(walks, refused(GROUP, NAMES, reason))
    return Gait(walks, _measures(motion, walks, steps))


def _measures(motion: Motion, walks: tuple[Walk, ...], steps: list[Step]) -> tuple[Measure, ...]:
    frames = sum(walk.end - walk.first for walk in walks)
    place_m = _deviation_of_ankles(motion, walks)
    usual_s = float(np.median([step.seconds for step in steps]))
    step_s, step_sd = _step_time(walks, usual_s)
    cadence = 60.0 / step_s
    speeds = _speeds(motion, walks)
    weight, speed = np.array([s for s, _ in speeds]), np.array([v for _, v in speeds])
    mean_speed = float(weight @ speed / weight.sum())
    spread = float(np.sqrt(weight @ (speed - mean_speed) ** 2 / weight.sum())) / np.sqrt(len(speed))
    ends = np.sqrt(2) * place_m / weight.sum()
    speed_sd = float(np.linalg.norm([ends, spread, _SCALE * mean_speed]))
    cadence_sd = cadence * step_sd / step_s
    lengths = {s: np.array([t.length for t in steps if t.side == s]) for s in SIDES}
    widths = np.array([t.width for t in steps])
    stance, stride_s, double = _phases(walks, 2 * usual_s)
    step_off, share_off = np.sqrt(2) * place_m, np.sqrt(2) * _EVENT_S / max(2 * step_s, 0.1) * 100.0

    def measure(name: str, side: str, values: Array, each: float, of: str, common: float = 0.0) -> Measure:
        mean = mean_of(values, each, common)
        if not mean.count:
            reason = f"no {of[:-1]} was seen whole"
            return Measure(GROUP, name, side, np.nan, np.nan, NAMES[name], 0, of, frames, reason)
        return Measure(GROUP, name, side, mean.value, mean.deviation, NAMES[name], mean.count, of, frames)

    out = [
        Measure(GROUP, "speed", "", mean_speed, speed_sd, "m/s", len(speeds), "walks", frames),
        Measure(GROUP, "cadence", "", cadence, cadence_sd, "steps/min", len(steps), "steps", frames),
        *(measure("step length", s, lengths[s], step_off, "steps", _STEP_OFF_M) for s in SIDES),
        measure("step width", "", widths, step_off, "steps", _STEP_OFF_M),
        *(measure("stride time", s, stride_s[s], np.sqrt(2) * _EVENT_S, "strides") for s in SIDES),
        *(measure("stance", s, stance[s], share_off, "strides") for s in SIDES),
        *(measure("swing", s, 100.0 - stance[s], share_off, "strides") for s in SIDES),
        measure("double support", "", double, share_off, "strides"),
    ]  # fmt: skip
    known = {(m.name, m.side): m for m in out}
    out.insert(2, _of_both(known["step length", "left"], known["step length", "right"]))
    for name, of in (("step length", "steps"), ("stance", "strides")):
        left, right = (known[name, side] for side in SIDES)
        out.append(_symmetry(f"symmetry of {name}", left, right, of, frames))
    return tuple(out)


def _of_both(left: Measure, right: Measure) -> Measure:
    """Mean of both sides, of which one may have more steps."""
    if not (left.is_known and right.is_known):
        return replace(right if left.is_known else left, side="")
    return replace(
        left,
        side="",
        value=0.5 * (left.value + right.value),
        deviation=0.5 * float(np.hypot(left.deviation, right.deviation)),
        count=left.count + right.count,
    )


def _symmetry(name: str, left: Measure, right: Measure, of: str, frames: int) -> Measure:
    """Difference of left and right as a share of their mean, per cent."""
    count = min(left.count, right.count)
    if not count:
        reason = "one side has no value"
        return Measure(GROUP, name, "", np.nan, np.nan, "%", 0, of, frames, reason)
    mean = 0.5 * (left.value + right.value)
    value = 100.0 * (left.value - right.value) / mean
    deviation = 100.0 * float(np.hypot(left.deviation, right.deviation)) / mean
    return Measure(GROUP, name, "", value, deviation, "%", count, of, frames)


def _step_time(walks: tuple[Walk, ...], usual_s: float) -> tuple[float, float]:
    """Time of a step and its deviation, seconds: one slope through all strikes and toe-offs by their number.

    The mean time of successive steps would be that between the first and the last strike, and have their
    errors.
    """
    numbers, times = [], []
    for row in (row for walk in walks for row in _rows(walk, usual_s)):
        for kind in ([event.strike for event in row], [event.off for event in row]):
            seen = np.isfinite(kind)
            if seen.any():
                number, time = np.arange(len(row))[seen], np.array(kind)[seen]
                numbers.append(number - number.mean())
                times.append(time - time.mean())
    k, t = np.concatenate(numbers), np.concatenate(times)
    step_s = float(k @ t / (k @ k))
    scatter = float(np.sqrt(np.mean((t - k * step_s) ** 2)))
    return step_s, max(scatter, _EVENT_S) / float(np.sqrt(k @ k))


def _rows(walk: Walk, usual_s: float) -> list[list[Event]]:
    """Events that follow one another as steps do: of unlike feet, after a usual time."""
    rows: list[list[Event]] = []
    for event in walk.events:
        last = rows[-1][-1] if rows else None
        if last and last.side != event.side and _is_usual(event.strike - last.strike, usual_s):
            rows[-1].append(event)
        else:
            rows.append([event])
    return rows


def _deviation_of_ankles(motion: Motion, walks: tuple[Walk, ...]) -> float:
    """Typical deviation of a standing ankle, metres."""
    ankles = [JOINT_INDEX[f"{side}_ankle"] for side in SIDES]
    inside = np.zeros(len(motion), np.bool_)
    for walk in walks:
        inside[walk.first : walk.end] = True
    used = motion.deviations[inside & motion.present][:, ankles]
    return float(np.median(used))


def _speeds(motion: Motion, walks: tuple[Walk, ...]) -> list[tuple[float, float]]:
    """Duration and speed of each walk between its first and last strike, along its path."""
    out = []
    place, _ = pelvis_path(motion)
    for walk in walks:
        if len(walk.events) < 2:
            continue
        begin, end = walk.events[0].strike, walk.events[-1].strike
        inside = np.flatnonzero((motion.times >= begin) & (motion.times <= end))
        way = np.linalg.norm(np.diff(place[inside], axis=0), axis=1).sum()
        seconds = float(motion.times[inside[-1]] - motion.times[inside[0]])
        out.append((seconds, float(way) / seconds))
    return out


def _is_usual(seconds: float, usual_s: float) -> bool:
    """Whether a step or stride takes about as long as usual; else one of its events is false."""
    return abs(seconds - usual_s) <= _UNLIKE * usual_s


def _phases(walks: tuple[Walk, ...], usual_s: float) -> tuple[dict[str, Array], dict[str, Array], Array]:
    """Stance as per cent of the stride and duration of strides, by side; double support, per cent."""
    stance: dict[str, list[float]] = {side: [] for side in SIDES}
    seconds: dict[str, list[float]] = {side: [] for side in SIDES}
    double = []
    for walk in walks:
        for side in SIDES:
            own = [event for event in walk.events if event.side == side]
            other = [event for event in walk.events if event.side != side]
            for a, b in pairwise(own):
                stride = b.strike - a.strike
                if not _is_usual(stride, usual_s):
                    continue
                seconds[side].append(stride)
                if not np.isfinite(a.off):
                    continue
                stance[side].append(100.0 * (a.off - a.strike) / stride)
                both = [c for c in other if a.strike < c.strike < b.strike]
                before = [c for c in other if c.strike < a.strike < c.off]
                if both and before and both[0].strike < a.off:
                    double.append(100.0 * (a.off - both[0].strike + before[-1].off - a.strike) / stride)
    return (
        {s: np.array(v) for s, v in stance.items()},
        {s: np.array(v) for s, v in seconds.items()},
        np.array(double),
    )
