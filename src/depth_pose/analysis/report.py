"""Reports of recordings: gait, rising, standing and ranges of motion of each person."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from depth_pose.analysis.gait import GROUP as GAIT
from depth_pose.analysis.gait import NAMES as GAIT_NAMES
from depth_pose.analysis.gait import Gait, analyse_gait
from depth_pose.analysis.measures import Measure, refused
from depth_pose.analysis.motion import Motion, motion_on_floor
from depth_pose.analysis.ranges import Range, range_measures, ranges_of_motion
from depth_pose.analysis.rising import GROUP as RISING
from depth_pose.analysis.rising import NAMES as RISING_NAMES
from depth_pose.analysis.rising import Rising, analyse_rising
from depth_pose.analysis.sway import GROUP as SWAY
from depth_pose.analysis.sway import NAMES as SWAY_NAMES
from depth_pose.analysis.sway import Sway, analyse_sway
from depth_pose.core.errors import InputError
from depth_pose.detect.floor import Floor
from depth_pose.export.floor import find_floor, on_floor
from depth_pose.export.tracks import Track, Tracks, chosen, even_step_s, read_tracks
from depth_pose.io.recording import read_metadata
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.offline import FLOOR, has_moved
from depth_pose.rooms.rig import ROOM_FRAME

LEAST_S = 1.0
"""Minimum time for which somebody is seen whole to be in a report."""
MOST_TILT_DEG = 6.0
"""Maximum deviation of the up direction (degrees) for measures on the floor: 12 cm at a
height of 1.2 m."""


@dataclass(frozen=True)
class PersonReport:
    """What a recording says about one person.

    Attributes
    ----------
    body_id : str
    motion : Motion
    gait : Gait
    rising : Rising
    sway : Sway
    ranges : tuple of Range
    """

    body_id: str
    motion: Motion
    gait: Gait
    rising: Rising
    sway: Sway
    ranges: tuple[Range, ...]

    @property
    def measures(self) -> tuple[Measure, ...]:
        """All measures, those that are not known included."""
        parts = (self.gait.measures, self.rising.measures, self.sway.measures, range_measures(self.ranges))
        return tuple(measure for part in parts for measure in part)


@dataclass(frozen=True)
class Report:
    """What a recording says about everybody in it.

    Attributes
    ----------
    name : str
        The recording's name.
    frames : int
        Frames of the recording.
    rate_hz : float
    floor : str
        Where the floor is known from, or why it is not.
    people : tuple of PersonReport
    left_out : tuple of str
        People who are seen for too short a time.
    """

    name: str
    frames: int
    rate_hz: float
    floor: str
    people: tuple[PersonReport, ...]
    left_out: tuple[str, ...]


def analyse_recording(
    skeletons: Path | str,
    *,
    people: Sequence[str] = (),
    recording: Path | str | None = None,
    topic: str = PEOPLE_TOPIC,
    depth_topic: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Measure gait, rising, standing and ranges of motion of the people in a recording of skeletons.

    Parameters
    ----------
    skeletons : Path or str
        The recording of skeletons, as `depth-pose run` writes it.
    people : sequence of str
        Only these ``body_id``; all if empty.
    recording : Path or str, optional
        The depth recording in which to find the floor; without it, the floor is the one that `run` recorded,
        or is estimated from feet.
    topic, depth_topic : str, optional
        The topics.
    progress : callable, optional
        Called with the number of people done.

    Raises
    ------
    InputError
        Where the recording cannot be read, or has nobody for `LEAST_S`.
    """
    tracks = chosen(read_tracks(skeletons, topic), people, skeletons)
    floor, said, doubt = _floor(tracks, skeletons, recording, depth_topic)
    if floor is not None:
        tracks = on_floor(tracks, floor)
    step_s = even_step_s(tracks.stamps_ns)
    long = [track for track in tracks.people if track.present.sum() * step_s >= LEAST_S]
    if not long:
        raise InputError(f"{skeletons} shows nobody for {LEAST_S:.0f} s; there is nothing to measure")
    reports = []
    for track in long:
        reports.append(_person(track, step_s, int(tracks.stamps_ns[0]), floor, doubt))
        if progress:
            progress(len(reports))
    others = tuple(track.body_id for track in tracks.people if track not in long)
    return Report(Path(skeletons).name, len(tracks.stamps_ns), 1.0 / step_s, said, tuple(reports), others)


def _floor(
    tracks: Tracks, skeletons: Path | str, recording: Path | str | None, depth_topic: str | None
) -> tuple[Floor | None, str, str]:
    """Find the floor; return it, where it is known from, and why measures on it are not possible."""
    if tracks.frame_id == ROOM_FRAME:
        return None, "known from the calibration of the room", ""
    if has_moved(read_metadata(skeletons, FLOOR)):
        return None, "not known: the sensor moved", "the sensor moved while it recorded"
    try:
        floor = find_floor(tracks.people, skeletons, recording, depth_topic)
    except InputError as error:
        return None, f"not known: {error}", f"no floor: {error}"
    said = (
        f"found in the {floor.source}" if floor.source != "feet" else "estimated from feet"
    ) + f", height to {100 * floor.deviation:.0f} cm, level to {floor.tilt_deviation_deg:.1f} degrees"
    if floor.tilt_deviation_deg > MOST_TILT_DEG:
        doubt = f"no floor: which way is up is known to {floor.tilt_deviation_deg:.0f} degrees only"
        return None, f"not known: {doubt.removeprefix('no floor: ')}", doubt
    return floor, said, ""


def _person(track: Track, step_s: float, start_ns: int, floor: Floor | None, doubt: str) -> PersonReport:
    tilt = 0.0 if floor is None else floor.tilt_deviation_deg
    motion = motion_on_floor(track, step_s, start_ns, tilt_deg=None if doubt else tilt)
    ranges = ranges_of_motion(motion, not doubt)
    if doubt:
        gait = Gait((), refused(GAIT, GAIT_NAMES, doubt))
        rising = Rising((), refused(RISING, RISING_NAMES, doubt))
        sway = Sway(np.zeros((0, 2)), np.zeros(0), refused(SWAY, SWAY_NAMES, doubt))
        return PersonReport(track.body_id, motion, gait, rising, sway, ranges)
    return PersonReport(
        track.body_id, motion, analyse_gait(motion), analyse_rising(motion), analyse_sway(motion), ranges
    )
