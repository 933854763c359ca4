"""Process a room offline: from the recordings of several cameras to one recording of skeletons."""

from __future__ import annotations

import heapq
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from depth_pose.core.errors import InputError
from depth_pose.io.mcap_write import SkeletonWriter
from depth_pose.rooms.camera_frame import CameraFrame
from depth_pose.rooms.clock_course import ClockCourses
from depth_pose.rooms.fit_check import FitCheck
from depth_pose.rooms.fusion import RoomFusion, RoomResult
from depth_pose.rooms.merge import place
from depth_pose.rooms.rig import ROOM_FRAME
from depth_pose.rooms.watching import Watched, read_spool

_SILENT = 2.5
"""Number of frame periods without a frame of the leading camera after which other cameras' frames are
answered."""

_FASTER = 0.8
"""Maximum frame period, as a share of an earlier camera's, of a camera that leads instead; set by hand."""

_CLOCK_PASSES = 4
"""Maximum number of estimates of the clocks: people turn, so the first ones are short of a large offset."""

_LEAST_PERIOD_NS = 1_000_000
"""Least frame period, nanoseconds."""


@dataclass(frozen=True)
class RoomSummary:
    """Summary of a room's run.

    Attributes
    ----------
    moments : int
        Answered frames of the leading camera, and of others while it was silent.
    empty : int
        Moments without a person.
    most_people : int
        Most people at one moment.
    shared : float
        Share of the skeletons that combine several cameras.
    ids : int
        Different people.
    sources : dict of str to int
        Number of skeletons by source.
    fuse_ms : float
        Median time of the fusion of one moment, milliseconds.
    leader : str
        Name of the camera whose frames are answered.
    """

    moments: int
    empty: int
    most_people: int
    shared: float
    ids: int
    sources: dict[str, int]
    fuse_ms: float
    leader: str


def process_room(
    watched: Sequence[Watched],
    fusion: RoomFusion,
    output: Path,
    progress: Callable[[int], None] | None = None,
    *,
    markers: bool = False,
) -> RoomSummary:
    """Fuse the frames of all cameras and write the skeletons in the room's frame.

    Parameters
    ----------
    watched : sequence of Watched
        One for each camera of the rig.
    fusion : RoomFusion
    output : Path
        The recording of skeletons; stamps are in the first camera's clock.
    progress : callable, optional
        Called with the number of frames done, of all cameras.
    markers : bool
        Whether to write standard markers as well.

    Raises
    ------
    InputError
        Where the recordings do not overlap in time.
    PartlyWritten
        After Ctrl-C, where something was done.
    """
    _check_overlap(watched, fusion)
    leader, period_ns = _leader(watched)
    fusion.reset()
    sources, ids, times_ms = Counter[str](), set[str](), list[float]()
    empty = most = shared = 0
    last_ns: int | None = None
    with SkeletonWriter(output) as writer:
        for count, (stamp_ns, camera, frame) in enumerate(in_order(watched, fusion.room_stamp), 1):
            start = time.perf_counter()
            fusion.take(camera, frame)
            is_silent = last_ns is None or stamp_ns - last_ns > _SILENT * period_ns
            if camera == leader or is_silent:
                last_ns = stamp_ns
                result = fusion.answer(stamp_ns)
                times_ms.append((time.perf_counter() - start) * 1e3)
                _write(writer, result, stamp_ns, markers)
                everybody = result.skeletons
                sources.update(s.source.name for s in everybody)
                ids.update(s.body_id for s in everybody)
                empty += not everybody
                most = max(most, len(everybody))
                shared += fusion.fitted
            if progress:
                progress(count)
    return RoomSummary(
        moments=len(times_ms),
        empty=empty,
        most_people=most,
        shared=shared / max(1, sources.total()),
        ids=len(ids),
        sources=dict(sources),
        fuse_ms=float(np.median(times_ms)),
        leader=fusion.rig.cameras[leader].name,
    )


def correct_clocks(watched: Sequence[Watched], fusion: RoomFusion) -> list[str]:
    """Estimate and set the clocks of the cameras; return a line for each that differs."""
    for _ in range(_CLOCK_PASSES):
        courses = ClockCourses([camera.T_room_camera for camera in fusion.rig.cameras])
        for room_ns, camera, frame in in_order(watched, fusion.room_stamp):
            courses.add(camera, frame.stamp_ns, room_ns, frame.skeletons)
        more = courses.courses()
        if not any(any(course.offsets_s) for course in more):
            break
        fusion.clocks = [a.plus(b) for a, b in zip(fusion.clocks, more, strict=True)]
    names = [camera.name for camera in fusion.rig.cameras]
    return list(filter(None, (c.line(n, names[0]) for c, n in zip(fusion.clocks, names, strict=True))))


def misfits(watched: Sequence[Watched], fusion: RoomFusion) -> list[str]:
    """Return a line for each camera that does not fit the others, from the people whom two of them see."""
    cameras = fusion.rig.cameras
    check = FitCheck([c.name for c in cameras])
    for k, one in enumerate(watched):
        T = cameras[k].T_room_camera
        for frame in read_spool(one.spool):
            placed = [place(s, T, ROOM_FRAME) for s in frame.skeletons if not s.is_lost]
            check.add(k, fusion.room_stamp(k, frame.stamp_ns), placed)
    return list(dict.fromkeys(check.judge_all().values()))


def _write(writer: SkeletonWriter, result: RoomResult, stamp_ns: int, markers: bool) -> None:
    writer.write_people(result.skeletons, stamp_ns, ROOM_FRAME)
    writer.write(result.skeleton)
    if markers:
        writer.write_markers(result.skeletons, stamp_ns, ROOM_FRAME)


def in_order(
    watched: Sequence[Watched], room_stamp: Callable[[int, int], int]
) -> Iterator[tuple[int, int, CameraFrame]]:
    """Yield the frames of all cameras by their stamps in the first one's clock.

    Parameters
    ----------
    watched : sequence of Watched
    room_stamp : callable
        From a camera's number and stamp (ns) to the stamp in the first one's clock.

    Yields
    ------
    tuple
        That stamp, the camera's number, and the frame.
    """

    def of_camera(camera: int) -> Iterator[tuple[int, int, CameraFrame]]:
        for frame in read_spool(watched[camera].spool):
            yield room_stamp(camera, frame.stamp_ns), camera, frame

    return heapq.merge(*map(of_camera, range(len(watched))), key=lambda one: one[:2])


def _leader(watched: Sequence[Watched]) -> tuple[int, int]:
    """Return the fastest camera, the first of those that are about as fast, and its frame period (ns)."""
    periods = [
        int(np.median(np.diff(w.stamps_ns))) if len(w.stamps_ns) > 1 else np.iinfo(np.int64).max
        for w in watched
    ]
    leader = 0
    for camera, period in enumerate(periods):
        if period < _FASTER * periods[leader]:
            leader = camera
    return leader, max(periods[leader], _LEAST_PERIOD_NS)


def _check_overlap(watched: Sequence[Watched], fusion: RoomFusion) -> None:
    """Reject recordings of which one ends before another begins."""
    names = [camera.name for camera in fusion.rig.cameras]
    spans = [
        (fusion.room_stamp(k, w.stamps_ns[0]), fusion.room_stamp(k, w.stamps_ns[-1]), names[k])
        for k, w in enumerate(watched)
    ]
    last, first = max(spans), min(spans, key=lambda span: span[1])
    if last[0] > first[1]:
        raise InputError(
            f"the recording of {last[2]} begins {(last[0] - first[1]) * 1e-9:.1f} s after that of {first[2]} "
            "ends: recordings of one room overlap in time. If the clocks differ, clock_offset of each camera "
            "in the rig file is subtracted from its stamps"
        )
