r"""Estimate the clocks of recorded cameras over time, from people who walk; clocks may step.

The offset of a camera's clock is that of `depth_pose.rooms.clock`: sightings with velocity :math:`v` lie
:math:`d = -v\,o` from where other cameras see the person. Over a recording it is piecewise constant: where
two offsets explain the sightings much better than one, the recording is divided there, and so on.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.result import Skeleton
from depth_pose.rooms.clock import CORRELATED_S, ENOUGH_S, SLOW_M_S
from depth_pose.rooms.merge import place
from depth_pose.rooms.rig import ROOM_FRAME
from depth_pose.rooms.sightings import RoomSighting
from depth_pose.rooms.tracks import Comparison, RoomTracks
from depth_pose.rooms.watch import CLOCK_S

_FARTHEST_M = 1.0
"""Maximum distance (m) of two views of a person that tell their clocks; set by hand."""

_BETTER = 20.0
"""Minimum decrease of the squared error by a step, in variances: one in 20,000 by chance. Set by hand."""

_SURE = 3.0
"""Number of standard deviations by which an offset must exceed `CLOCK_S`; set by hand."""


@dataclass(frozen=True)
class ClockCourse:
    """How much a camera's stamps are too large over a recording, beyond the rig's offset.

    Attributes
    ----------
    since_ns : tuple of int
        Stamps of the camera from which the offsets hold, ascending; the first holds before, too.
    offsets_s : tuple of float
    """

    since_ns: tuple[int, ...] = (0,)
    offsets_s: tuple[float, ...] = (0.0,)

    def offset_s(self, stamp_ns: int) -> float:
        """Return the offset (s) at a stamp of the camera."""
        return self.offsets_s[max(bisect_right(self.since_ns, stamp_ns) - 1, 0)]

    def plus(self, other: ClockCourse) -> ClockCourse:
        """Return the sum of two."""
        since = sorted({*self.since_ns, *other.since_ns})
        offsets = [self.offset_s(ns) + other.offset_s(ns) for ns in since]
        return ClockCourse(tuple(since), tuple(offsets))

    def line(self, name: str, other: str) -> str:
        """Describe it; empty where the clocks agree."""
        if not any(self.offsets_s):
            return ""
        each = [f"{1e3 * abs(o):.0f} ms {'ahead of' if o > 0 else 'behind'}" for o in self.offsets_s]
        then = ", then ".join(one for one, _ in groupby(each))
        return (
            f"the clock of {name} is {then} that of {other}: its stamps are corrected; "
            "synchronise the clocks (chrony, PTP)"
        )


class ClockCourses:
    """Collects what the cameras see, and estimates their clocks.

    Parameters
    ----------
    T_room_camera : sequence of (4, 4) float64
        Optical frame of each camera to the room's frame.
    """

    def __init__(self, T_room_camera: Sequence[NDArray[np.float64]]) -> None:
        self._places = list(T_room_camera)
        self._tracks = RoomTracks()
        self._samples: list[list[tuple[int, float, float, float, float]]] = [[] for _ in self._places]

    def add(self, camera: int, stamp_ns: int, room_ns: int, skeletons: Iterable[Skeleton]) -> None:
        """Add a frame, in the order of the room's stamps.

        Parameters
        ----------
        camera : int
        stamp_ns, room_ns : int
            In the camera's clock, and in the room's as far as it is known.
        skeletons : iterable of Skeleton
            The camera's, in its frame.
        """
        placed = (place(s, self._places[camera], ROOM_FRAME) for s in skeletons if not s.is_lost)
        self._tracks.assign(camera, room_ns, [RoomSighting.of(s) for s in placed])
        samples = self._samples[camera]
        passed_s = (stamp_ns - samples[-1][0]) * 1e-9 if samples else CORRELATED_S
        for each in self._tracks.compare(camera, room_ns):
            self._add(camera, stamp_ns, abs(passed_s), each)

    def _add(self, camera: int, stamp_ns: int, passed_s: float, each: Comparison) -> None:
        v, d = each.velocity[:2], each.difference[:2]
        if math.hypot(*v.tolist()) >= SLOW_M_S and math.hypot(*d.tolist()) <= _FARTHEST_M:
            weight = min(passed_s, CORRELATED_S)
            sums = (weight * float(v @ v), weight * float(v @ d), weight * float(d @ d))
            self._samples[camera].append((stamp_ns, weight, *sums))

    def courses(self) -> list[ClockCourse]:
        """Return the clock of each camera; the room's is camera 0's."""
        return [ClockCourse(), *map(_course, self._samples[1:])]


def _course(samples: list[tuple[int, float, float, float, float]]) -> ClockCourse:
    if not samples:
        return ClockCourse()
    stamps = np.array([sample[0] for sample in samples])
    sums = np.cumsum(np.vstack([np.zeros(4), [sample[1:] for sample in samples]]), axis=0)
    starts = [0, *_steps(sums, 0, len(samples))]
    offsets = [_offset(sums, a, b) for a, b in zip(starts, [*starts[1:], len(samples)], strict=True)]
    return ClockCourse(tuple(stamps[starts].tolist()), tuple(offsets))


def _steps(sums: NDArray[np.float64], first: int, last: int) -> list[int]:
    """Return where a stretch of samples is divided (binary segmentation), ascending."""
    at = np.arange(first + 1, last)
    walked = sums[:, 0]
    at = at[(walked[at] - walked[first] >= ENOUGH_S) & (walked[last] - walked[at] >= ENOUGH_S)]
    if len(at) == 0:
        return []
    rest = _rest(sums[at] - sums[first]) + _rest(sums[last] - sums[at])
    k = int(np.argmin(rest))
    step = int(at[k])
    whole, walked_s = float(_rest(sums[last] - sums[first])), walked[last] - walked[first]
    variance = max(float(rest[k]), 1e-9) / (2.0 * walked_s)  # of each direction, m^2
    differ = abs(_estimate(sums, first, step) - _estimate(sums, step, last)) > CLOCK_S
    if not differ or (whole - float(rest[k])) / CORRELATED_S < _BETTER * variance:
        return []
    return [*_steps(sums, first, step), step, *_steps(sums, step, last)]


def _rest(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum of squares that the best offset leaves."""
    return np.asarray(sums[..., 3] - sums[..., 2] ** 2 / np.maximum(sums[..., 1], 1e-12))


def _estimate(sums: NDArray[np.float64], first: int, last: int) -> float:
    _, vv, vd, _ = sums[last] - sums[first]
    return float(-vd / max(vv, 1e-12))


def _offset(sums: NDArray[np.float64], first: int, last: int) -> float:
    """Return the offset (s) of a stretch; 0 where it is small or not sure."""
    walked_s, vv, *_ = part = sums[last] - sums[first]
    if walked_s < ENOUGH_S:
        return 0.0
    deviation = math.sqrt(0.5 * max(float(_rest(part)), 0.0) / walked_s * CORRELATED_S / vv)
    offset = _estimate(sums, first, last)
    return offset if abs(offset) - _SURE * deviation > CLOCK_S else 0.0
