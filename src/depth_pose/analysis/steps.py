r"""Straight walks, their events and steps, from joints above a floor.

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
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from depth_pose.analysis.measures import Array
from depth_pose.analysis.motion import Motion, runs
from depth_pose.core.rotations import unit_vectors

SIDES = ("left", "right")

_WALKING_M_S = 0.25
"""Minimum speed of the pelvis while walking. Set by hand: slow frail walkers have .4 m/s."""
_PAUSE_S = 0.3
"""Maximum time below that speed within a walk: slow walkers almost stand at each step. Set by hand: less than
a step."""
_SLOW_S = 0.35
"""Width of the Gaussian that leaves the pelvis its path but not its swaying, seconds. Set by hand."""
_TURN_DEG_S = 45.0
"""Maximum rate of turning of a straight walk. Set by hand."""
LEAST_S = 1.0
"""Minimum duration of a walk: two steps. Set by hand."""
_LEAST_SWING_M = 0.08
"""Minimum swing of a foot before and behind the pelvis. Set by hand."""
_STEP_S = (0.25, 1.6)
"""Range of times of a step. Set by hand: 37 to 240 steps a minute."""
_FLAT = (0.2, 0.7)
"""Part of the stance in which a foot does not move. Set by hand, from published curves (Winter 1991)."""


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


def pelvis_path(motion: Motion) -> tuple[Array, Array]:
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


def straight_parts(motion: Motion) -> list[tuple[int, int]]:
    """Frames in which somebody walks forward and straight, as parts of at least `LEAST_S`."""
    _, velocity = pelvis_path(motion)
    speed = np.linalg.norm(velocity, axis=1)
    walking = speed > _WALKING_M_S
    for first, end in runs(~walking & motion.present):
        between = first > 0 and end < len(motion) and walking[first - 1] and walking[end]
        walking[first:end] |= between and end - first <= _PAUSE_S * motion.rate_hz
    heading = np.arctan2(velocity[:, 1], velocity[:, 0])
    turning = np.zeros(len(motion))
    for first, end in runs(walking):
        if end - first > 2:
            unwrapped = np.unwrap(heading[first:end])
            turning[first:end] = np.degrees(np.abs(np.gradient(unwrapped, 1.0 / motion.rate_hz)))
    left = motion.at("left_hip") - motion.at("right_hip")
    ahead = left[:, 1] * velocity[:, 0] - left[:, 0] * velocity[:, 1] > 0.0  # faces the way it goes
    parts = runs(walking & (turning < _TURN_DEG_S) & ahead)
    return [(a, b) for a, b in parts if b - a >= LEAST_S * motion.rate_hz]


def find_walk(motion: Motion, first: int, end: int) -> Walk:
    """Find the events of one straight part."""
    _, velocity = pelvis_path(motion)
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
class Step:
    """From one foot's strike to the other's: its side is that of the second."""

    side: str
    seconds: float
    length: float
    width: float


def steps_of(walk: Walk) -> list[Step]:
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
        out.append(Step(b.side, seconds, float(line @ apart), float(width)))
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
