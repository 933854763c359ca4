r"""Steps and strides of somebody who walks on a floor.

**Events** after J. A. Zeni, J. G. Richards and J. S. Higginson, *Two simple methods for determining gait
events during treadmill and overground walking using kinematic data*, Gait and Posture 27, 2008: with
:math:`d` the direction of walking, a heel strikes where :math:`d \cdot (p_{ankle} - p_{pelvis})` is
greatest, and a foot leaves where :math:`d \cdot (p_{toe} - p_{pelvis})` is least; times are refined between
frames by a parabola.

**Steps** between footprints, as instrumented walkways measure them (B. Bilney, M. Morris, K. Webster,
*Concurrent related validity of the GAITRite walkway system*, Gait and Posture 17, 2003): a footprint is the
median place of the ankle while its foot stands. Length is along the line from the last footprint of the same
foot to the next one, width across it. Errors that last longer than a step cancel in neither, so a footprint
has the deviation of one ankle.

**Symmetry**: R. O. Robinson, W. Herzog and B. M. Nigg, J. Manip. Physiol. Ther. 10, 1987: the difference of
left and right as a share of their mean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from depth_pose.analysis.measures import Array, Measure, mean_of, refused, too_slow
from depth_pose.analysis.motion import Motion, runs
from depth_pose.core.rotations import unit_vectors
from depth_pose.core.skeleton import JOINT_INDEX

SIDES = ("left", "right")
GROUP = "gait"

_WALKING_M_S = 0.25
"""Minimum speed of the pelvis while walking. Set by hand: slow frail walkers have .4 m/s."""
_SLOW_S = 0.35
"""Width of the Gaussian that leaves the pelvis its path but not its swaying, seconds. Set by hand."""
_TURN_DEG_S = 45.0
"""Maximum rate of turning of a straight walk. Set by hand."""
_LEAST_S = 1.0
"""Minimum duration of a walk: two steps. Set by hand."""
_LEAST_SWING_M = 0.08
"""Minimum swing of a foot before and behind the pelvis. Set by hand."""
_STEP_S = (0.25, 1.6)
"""Range of times of a step. Set by hand: 37 to 240 steps a minute."""
_UNLIKE = 0.4
"""Maximum difference of a step's time from the median, as a share of it. Set by hand: a limp is less."""
_FLAT = (0.2, 0.7)
"""Part of the stance in which a foot does not move. Set by hand, from published curves (Winter 1991)."""
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
class Event:
    """A foot touches down, or leaves the floor.

    Attributes
    ----------
    side : str
        ``left`` or ``right``.
    strike : float
        Time of the heel strike, seconds.
    off : float
        Time of the toe-off that ends this stance, seconds; NaN where it was not seen.
    place : (2,) float64
        The ankle's place on the floor while the foot stands, metres; NaN where it was not seen.
    """

    side: str
    strike: float
    off: float
    place: Array


@dataclass(frozen=True)
class Walk:
    """A straight walk.

    Attributes
    ----------
    first, end : int
        Its frames: the first, and the one after the last.
    events : tuple of Event
        In order of time; steps are between successive ones of unlike sides.
    """

    first: int
    end: int
    events: tuple[Event, ...]


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
    parts = _straight_parts(motion)
    if not parts:
        return Gait((), refused(GROUP, NAMES, f"nobody walks straight for {_LEAST_S:.0f} s or more"))
    ankles = motion.is_sure("left_ankle", "right_ankle")
    seen = [part for part in parts if ankles[slice(*part)].mean() >= LEAST_SURE]
    if not seen:
        share = max(float(ankles[slice(*part)].mean()) for part in parts)
        reason = (
            f"both ankles are sure in at most {share:.0%} of a walk's frames; {LEAST_SURE:.0%} are needed"
        )
        return Gait((), refused(GROUP, NAMES, reason))
    walks = tuple(_walk(motion, *part) for part in seen)
    steps = [step for walk in walks for step in _steps(walk)]
    usual_s = float(np.median([step.seconds for step in steps])) if steps else 0.0
    steps = [step for step in steps if _is_usual(step.seconds, usual_s)]
    if len(steps) < LEAST_STEPS:
        reason = f"only {len(steps)} steps were seen whole; {LEAST_STEPS} are needed"
        return Gait(walks, refused(GROUP, NAMES, reason))
    return Gait(walks, _measures(motion, walks, steps))


def _path(motion: Motion) -> tuple[Array, Array]:
    """Smooth horizontal place and velocity of the pelvis, (T, 2) each; NaN in gaps."""
    place = np.full((len(motion), 2), np.nan)
    velocity = np.full_like(place, np.nan)
    for first, end in runs(motion.present):
        if end - first > 2:
            path = motion.at("pelvis")[first:end, :2]
            slow = _smooth(path, _SLOW_S * motion.rate_hz)
            place[first:end] = slow
            velocity[first:end] = np.gradient(slow, 1.0 / motion.rate_hz, axis=0)
    return place, velocity


def _smooth(path: Array, width: float) -> Array:
    """Smooth a path (T, 2); it goes on straight beyond its ends."""
    pad = min(round(3 * width), len(path) - 1)
    before = 2 * path[0] - path[pad:0:-1]
    after = 2 * path[-1] - path[-2 : -pad - 2 : -1]
    long = gaussian_filter1d(np.concatenate([before, path, after]), width, axis=0, mode="nearest")
    return np.asarray(long[pad : pad + len(path)])


def _straight_parts(motion: Motion) -> list[tuple[int, int]]:
    """Frames in which somebody walks forward and straight, as parts of at least `_LEAST_S`."""
    _, velocity = _path(motion)
    speed = np.linalg.norm(velocity, axis=1)
    walking = speed > _WALKING_M_S
    heading = np.arctan2(velocity[:, 1], velocity[:, 0])
    turning = np.zeros(len(motion))
    for first, end in runs(walking):
        if end - first > 2:
            unwrapped = np.unwrap(heading[first:end])
            turning[first:end] = np.degrees(np.abs(np.gradient(unwrapped, 1.0 / motion.rate_hz)))
    left = motion.at("left_hip") - motion.at("right_hip")
    ahead = left[:, 1] * velocity[:, 0] - left[:, 0] * velocity[:, 1] > 0.0  # faces the way it goes
    parts = runs(walking & (turning < _TURN_DEG_S) & ahead)
    return [(a, b) for a, b in parts if b - a >= _LEAST_S * motion.rate_hz]


def _walk(motion: Motion, first: int, end: int) -> Walk:
    """Find the events of one straight part."""
    _, velocity = _path(motion)
    ahead = unit_vectors(velocity[first:end])
    events: list[Event] = []
    for side in SIDES:
        before = {
            joint: np.sum(ahead * (motion.at(joint) - motion.at("pelvis"))[first:end, :2], axis=1)
            for joint in (f"{side}_ankle", f"{side}_foot")
        }
        strikes = _peaks(before[f"{side}_ankle"], motion.rate_hz)
        offs = _peaks(-before[f"{side}_foot"], motion.rate_hz)
        times = [motion.times[first] + s / motion.rate_hz for s in strikes]
        for i, strike in enumerate(times):
            later = [motion.times[first] + o / motion.rate_hz for o in offs]
            until = times[i + 1] if i + 1 < len(times) else np.inf
            off = next((o for o in later if strike < o < until), np.nan)
            events.append(Event(side, strike, float(off), _footprint(motion, first, end, side, strike, off)))
    return Walk(first, end, tuple(sorted(events, key=lambda event: event.strike)))


def _peaks(signal: Array, rate_hz: float) -> list[float]:
    """Return times of a periodic signal's greatest values, in frames, refined by a parabola."""
    found, _ = find_peaks(signal, prominence=_LEAST_SWING_M, distance=max(1, round(_STEP_S[0] * rate_hz)))
    out = []
    for i in found:
        before, here, after = signal[i - 1 : i + 2]
        bend = before - 2 * here + after
        out.append(float(i + (0.5 * (before - after) / bend if bend < 0 else 0.0)))
    return out


def _footprint(motion: Motion, first: int, end: int, side: str, strike: float, off: float) -> Array:
    """Median place of a standing ankle, (2,); NaN where it was not seen."""
    usual = 0.6 if not np.isfinite(off) else off - strike  # the stance of a usual stride, seconds
    low, high = (strike + share * usual for share in _FLAT)
    inside = (motion.times >= low) & (motion.times <= high)
    inside &= motion.is_sure(f"{side}_ankle")
    inside[:first] = inside[end:] = False
    if inside.sum() < 2:
        return np.full(2, np.nan)
    return np.asarray(np.median(motion.at(f"{side}_ankle")[inside, :2], axis=0))


@dataclass(frozen=True)
class _Step:
    """From one foot's strike to the other's: its side is that of the second."""

    side: str
    seconds: float
    length: float
    width: float


def _steps(walk: Walk) -> list[_Step]:
    """Return steps between successive strikes of unlike feet."""
    out = []
    for i in range(1, len(walk.events)):
        a, b = walk.events[i - 1], walk.events[i]
        seconds = b.strike - a.strike
        if a.side == b.side or not _STEP_S[0] <= seconds <= _STEP_S[1]:
            continue
        line = _line(walk, i)
        apart = b.place - a.place
        across = line[0] * apart[1] - line[1] * apart[0]  # to the left of the line
        width = across if b.side == "left" else -across
        out.append(_Step(b.side, seconds, float(line @ apart), float(width)))
    return out


def _line(walk: Walk, i: int) -> Array:
    """Direction of walking at a step: between the footprints of the same foot around it."""
    places = [event.place for event in walk.events]
    pairs = [(j - 2, j) for j in (i, i + 1) if j - 2 >= 0 and j < len(places)]
    strides = [places[b] - places[a] for a, b in pairs if walk.events[a].side == walk.events[b].side]
    strides = [stride for stride in strides if np.isfinite(stride).all()]
    if not strides:
        return np.full(2, np.nan)
    return np.asarray(unit_vectors(np.sum(strides, axis=0)))


def _measures(motion: Motion, walks: tuple[Walk, ...], steps: list[_Step]) -> tuple[Measure, ...]:
    frames = sum(walk.end - walk.first for walk in walks)
    place_m = _deviation_of_ankles(motion, walks)
    seconds = np.array([step.seconds for step in steps])
    time = mean_of(seconds, np.sqrt(2) * _EVENT_S)
    cadence = 60.0 / time.value
    speeds = _speeds(motion, walks)
    weight, speed = np.array([s for s, _ in speeds]), np.array([v for _, v in speeds])
    mean_speed = float(weight @ speed / weight.sum())
    spread = float(np.sqrt(weight @ (speed - mean_speed) ** 2 / weight.sum())) / np.sqrt(len(speed))
    ends = np.sqrt(2) * place_m / weight.sum()
    speed_sd = float(np.linalg.norm([ends, spread, _SCALE * mean_speed]))
    cadence_sd = cadence * time.deviation / time.value
    lengths = {s: np.array([t.length for t in steps if t.side == s]) for s in SIDES}
    widths = np.array([t.width for t in steps])
    stance, stride_s, double = _phases(walks, 2 * float(np.median(seconds)))
    step_off, share_off = np.sqrt(2) * place_m, np.sqrt(2) * _EVENT_S / max(2 * time.value, 0.1) * 100.0

    def measure(name: str, side: str, values: Array, each: float, of: str, common: float = 0.0) -> Measure:
        mean = mean_of(values, each, common)
        if not mean.count:
            reason = f"no {of[:-1]} was seen whole"
            return Measure(GROUP, name, side, np.nan, np.nan, NAMES[name], 0, of, frames, reason)
        return Measure(GROUP, name, side, mean.value, mean.deviation, NAMES[name], mean.count, of, frames)

    out = [
        Measure(GROUP, "speed", "", mean_speed, speed_sd, "m/s", len(speeds), "walks", frames),
        Measure(GROUP, "cadence", "", cadence, cadence_sd, "steps/min", time.count, "steps", frames),
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
    place, _ = _path(motion)
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
