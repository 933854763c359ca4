"""Merge the skeletons of several cameras: one per person, in the room's frame.

Its z is up, the floor is at z = 0; metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SmoothConfig
from depth_pose.core.result import Skeleton
from depth_pose.recover.smooth import low_pass, with_motion
from depth_pose.rooms.fit_check import FitCheck
from depth_pose.rooms.jumps import JumpMeter
from depth_pose.rooms.merge import PlacedSkeleton, merge_skeletons, place
from depth_pose.rooms.room_person import RoomPerson
from depth_pose.rooms.sides import agree_on_sides
from depth_pose.rooms.sightings import RoomSighting
from depth_pose.rooms.timelines import Timelines
from depth_pose.rooms.tracks import RoomTracks
from depth_pose.rooms.walks import Walks
from depth_pose.rooms.watch import CLOCK_S, MOVED_M, CameraState, CameraWatch
from depth_pose.track.state import FilterState

SEEN_NS = 200_000_000
"""Maximum age of a sighting that is merged (ns)."""

_KEPT_NS = 500_000_000
"""Maximum age of the last joints that decide left and right (ns); set by hand."""


@dataclass(eq=False)
class _Kept:
    """State of one person: the filter, and the last merged joints."""

    filter: FilterState = field(default_factory=FilterState)
    stamp_ns: int = 0
    positions: NDArray[np.float64] | None = None

    def moved_to(self, stamp_ns: int, velocity: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the last joints (19, 3) where they are not too old, moved by the velocity (m/s)."""
        span_ns = stamp_ns - self.stamp_ns
        if self.positions is None or not 0 <= span_ns <= _KEPT_NS:
            return None
        return self.positions + velocity * (span_ns * 1e-9)


class RoomMerger:
    """Merges the skeletons of several cameras as they arrive.

    Parameters
    ----------
    names : sequence of str
        Of the cameras.
    T_room_camera : sequence of (4, 4) float64 or None
        Optical frame of each camera to the room's frame; None as long as it is not known.
    frame_id : str
        Name of the room's frame.
    clock_offsets_s : sequence of float
        Offset by which each camera's stamps are too large, seconds; zero by default.
    smooth : SmoothConfig
        Of the low-pass filter on the merged joints.

    Attributes
    ----------
    T_room_camera : list of (4, 4) float64 or None
        As given; may be changed.
    tracks : RoomTracks
    watch : CameraWatch
    clock_offsets_s : list of float
        As corrected by the motion of people.
    """

    def __init__(
        self,
        names: Sequence[str],
        T_room_camera: Sequence[NDArray[np.float64] | None],
        frame_id: str = "room",
        clock_offsets_s: Sequence[float] = (),
        smooth: SmoothConfig | None = None,
    ) -> None:
        self.frame_id = frame_id
        self.T_room_camera = list(T_room_camera)
        self.clock_offsets_s = list(clock_offsets_s) or [0.0] * len(self.T_room_camera)
        self.tracks, self.watch = RoomTracks(), CameraWatch(names)
        self._walks = Walks()
        self._times = Timelines(len(self.T_room_camera))
        self._jumps = [JumpMeter() for _ in self.T_room_camera]
        self._fit, self._judged_s = FitCheck(names), -math.inf
        self._placed = list(self.T_room_camera)
        self._smooth = smooth or SmoothConfig()
        self._kept: dict[str, _Kept] = {}

    def warm_up(self) -> None:
        """Do nothing: there is nothing to compile."""

    def reset(self) -> None:
        """Forget everybody; the cameras' states are kept."""
        self.tracks.reset()
        self._walks.reset()
        self._fit.reset()
        self._kept = {}

    def room_stamp_ns(self, camera: int, stamp_ns: int) -> int:
        """Return a stamp of a camera in the room's clock."""
        return stamp_ns - round(self.clock_offsets_s[camera] * 1e9)

    def add(
        self,
        camera: int,
        stamp_ns: int,
        skeletons: Sequence[Skeleton],
        now_s: float | None = None,
        ids: Sequence[str] | None = None,
    ) -> bool:
        """Add the people of one frame of one camera.

        Parameters
        ----------
        camera : int
        stamp_ns : int
            In the camera's own clock.
        skeletons : sequence of Skeleton
            In the camera's optical frame; lost ones are left out.
        now_s : float, optional
            Time of the arrival, seconds; the stamp by default.
        ids : sequence of str, optional
            Of all people in the frame; those of the skeletons by default.

        Returns
        -------
        bool
            Whether the frame was taken: not where its stamp is wrong, or its camera is left out.
        """
        now_s = stamp_ns * 1e-9 if now_s is None else now_s
        time = self._times.judge(camera, self.room_stamp_ns(camera, stamp_ns), now_s)
        if time.skipped:
            return False
        if time.has_jumped:
            self.watch.jump(camera)
            self._fit.forget(camera)
            self._walks.forget(camera)
        self.watch.hear(camera, stamp_ns, now_s)
        names = [s.body_id for s in skeletons] if ids is None else ids
        is_bad = self.watch.count_people(camera, names, now_s)
        T, stamp_ns = self.T_room_camera[camera], self.room_stamp_ns(camera, stamp_ns)
        if T is None or is_bad:
            self.tracks.leave_out(camera)
        if time.apart_s:
            self.watch.reject(camera, time.apart_s, time.other)
        if T is None or is_bad or time.apart_s:
            self.check(now_s)
            return False
        placed = [place(s, T, self.frame_id) for s in skeletons if not s.is_lost]
        before = self._placed[camera]
        if before is None or not np.array_equal(before, T):
            self._fit.forget(camera)
            self._placed[camera] = T
        people = list(map(RoomSighting.of, placed))
        if self.watch.is_used(camera):
            self._fit.add(camera, stamp_ns, placed)
            ids = self.tracks.assign(camera, stamp_ns, people)
            for sample in self._walks.add(camera, stamp_ns, ids, people):
                if np.hypot(*sample.difference) <= MOVED_M:
                    self.watch.cameras[sample.camera].clock.add(sample)
            apart_m = self.tracks.compare(camera, stamp_ns)
        else:
            apart_m = self.tracks.compare_nearest(camera, stamp_ns, people)
        jump = self._jumps[camera].measure(stamp_ns, people)
        self.watch.compare(camera, stamp_ns, now_s, apart_m, jump)
        self.check(now_s)
        return self.watch.is_used(camera)

    def check(self, now_s: float) -> None:
        """Leave out cameras that stopped, lag or were moved, and name those whose places do not fit.

        Call it also while nothing arrives.
        """
        for camera in self.watch.check(now_s):
            if self.watch.cameras[camera].state == CameraState.MOVED:
                self.tracks.leave_out(camera)  # of others only the time is wrong: their people keep their ids
            self._fit.forget(camera)
        self._correct_clocks()
        if not 0.0 <= now_s - self._judged_s < self._fit.period_s:
            self._judged_s = now_s
            if (lines := self._fit.judge_next()) is not None:
                self.watch.mark_misfits(lines)

    def skeletons_at(self, stamp_ns: int) -> tuple[Skeleton, ...]:
        """Merge the recent sightings of all cameras.

        Parameters
        ----------
        stamp_ns : int
            In the room's clock, that of camera 0; everybody is moved to it.

        Returns
        -------
        tuple of Skeleton
            One per person, in the room's frame; without those that only one camera sees with too little
            confidence.
        """
        people = [p for p in self.tracks.people if p.is_sure]
        merged = [s for p in people if (s := self._merge(p, stamp_ns)) is not None]
        self._kept = {p.room_id: k for p in self.tracks.people if (k := self._kept.get(p.room_id))}
        return tuple(merged)

    def _merge(self, person: RoomPerson, stamp_ns: int) -> Skeleton | None:
        seen = [
            PlacedSkeleton(
                view.sighting.skeleton,
                T[:3, 3],
                person.offset(view, stamp_ns),
                abs(stamp_ns - view.stamp_ns) * 1e-9,
            )
            for camera, view in sorted(person.views.items())
            if (T := self.T_room_camera[camera]) is not None
            and view.sighting.skeleton is not None
            and abs(stamp_ns - view.stamp_ns) <= SEEN_NS
        ]
        if not seen:
            return None
        kept = self._kept.setdefault(person.room_id, _Kept())
        expected = kept.moved_to(stamp_ns, person.velocity)
        merged = merge_skeletons(agree_on_sides(seen, expected), person.room_id, stamp_ns, self.frame_id)
        kept.stamp_ns, kept.positions = stamp_ns, merged.positions
        before, kept.filter = kept.filter, low_pass(kept.filter, merged.positions, stamp_ns, self._smooth)
        return with_motion(merged, before, kept.filter)

    def _correct_clocks(self) -> None:
        """Correct the stamps of cameras whose people walk ahead or behind: the room's clock is camera 0's."""
        for camera, of in enumerate(self.watch.cameras[1:], start=1):
            found = of.clock.estimate
            if not found.exceeds(CLOCK_S):
                continue
            self.clock_offsets_s[camera] += found.offset_s
            of.clock.reset()
            self._walks.forget(camera)
            self._fit.forget(camera)
            offset_s = self.clock_offsets_s[camera]
            if replace(found, offset_s=offset_s).exceeds(0.0):
                where = f"{1e3 * abs(offset_s):.0f} ms {'ahead of' if offset_s > 0 else 'behind'}"
            else:
                where = "again"
            self.watch.tell(
                f"the clock of {of.name} is {where} that of {self.watch.cameras[0].name}: "
                "its stamps are corrected; synchronise the clocks (chrony, PTP)"
            )
