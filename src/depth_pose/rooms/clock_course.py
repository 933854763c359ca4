r"""Estimate the clocks of recorded cameras over time, from people who walk; clocks may step.

The offset of a camera's clock is that of `depth_pose.rooms.clock`. Over a recording it is piecewise constant:
where two offsets explain the sightings much better than one, the recording is divided there, and so on.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.result import Skeleton
from depth_pose.rooms.clock import ENOUGH_S, blocks_of, centred, estimate_offset, sums_of
from depth_pose.rooms.merge import place
from depth_pose.rooms.rig import ROOM_FRAME
from depth_pose.rooms.sightings import RoomSighting
from depth_pose.rooms.tracks import RoomTracks
from depth_pose.rooms.walks import CORRELATED_S, Walks
from depth_pose.rooms.watch import CLOCK_S

_FARTHEST_M = 1.0
"""Maximum distance (m) of two views of a person that tell their clocks; set by hand."""

_BETTER = 20.0
"""Minimum decrease of the squared error by a step, in variances: one in 20,000 by chance. Set by hand."""


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
        self._tracks, self._walks = RoomTracks(), Walks()
        self._stamps_ns: list[dict[int, int]] = [{} for _ in self._places]  # from the room's to the camera's
        self._samples: list[list[tuple[int, NDArray[np.float64]]]] = [[] for _ in self._places]

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
        people = [RoomSighting.of(s) for s in placed]
        ids = self._tracks.assign(camera, room_ns, people)
        self._stamps_ns[camera][room_ns] = stamp_ns
        for sample in self._walks.add(camera, room_ns, ids, people):
            sums = sums_of(sample)
            if sums is not None and np.hypot(*sample.difference) <= _FARTHEST_M:
                own_ns = self._stamps_ns[sample.camera][sample.stamp_ns]
                self._samples[sample.camera].append((own_ns, sums))

    def courses(self) -> list[ClockCourse]:
        """Return the clock of each camera; the room's is camera 0's."""
        return [ClockCourse(), *map(_course, self._samples[1:])]


def _course(samples: list[tuple[int, NDArray[np.float64]]]) -> ClockCourse:
    if not samples:
        return ClockCourse()
    stamps = [stamp_ns for stamp_ns, _ in samples]
    sums = np.array([each for _, each in samples])
    starts = [0, *_steps(np.cumsum(np.vstack([np.zeros(sums.shape[1]), sums]), axis=0), 0, len(samples))]
    offsets = [_offset(sums[a:b]) for a, b in zip(starts, [*starts[1:], len(samples)], strict=True)]
    return ClockCourse(tuple(stamps[start] for start in starts), tuple(offsets))


def _steps(totals: NDArray[np.float64], first: int, last: int) -> list[int]:
    """Return where a stretch of samples is divided (binary segmentation), ascending."""
    at = np.arange(first + 1, last)
    walked = totals[:, 0]
    at = at[(walked[at] - walked[first] >= ENOUGH_S) & (walked[last] - walked[at] >= ENOUGH_S)]
    if len(at) == 0:
        return []
    rest = _rest(totals[at] - totals[first]) + _rest(totals[last] - totals[at])
    k = int(np.argmin(rest))
    step = int(at[k])
    whole, walked_s = float(_rest(totals[last] - totals[first])), walked[last] - walked[first]
    variance = max(float(rest[k]), 1e-9) / (2.0 * walked_s)  # of each direction, m^2
    differ = abs(_best(totals[step] - totals[first]) - _best(totals[last] - totals[step])) > CLOCK_S
    if not differ or (whole - float(rest[k])) / CORRELATED_S < _BETTER * variance:
        return []
    return [*_steps(totals, first, step), step, *_steps(totals, step, last)]


def _rest(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum of squares that the best offset leaves."""
    vv, vd, dd = centred(sums)
    return np.asarray(dd - vd**2 / vv)


def _best(sums: NDArray[np.float64]) -> float:
    vv, vd, _ = centred(sums)
    return float(-vd / vv)


def _offset(sums: NDArray[np.float64]) -> float:
    """Return the offset (s) of a stretch of samples; 0 where it is small or not sure."""
    found = estimate_offset(blocks_of(sums))
    return found.offset_s if found.exceeds(CLOCK_S) else 0.0
