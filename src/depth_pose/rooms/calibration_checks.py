"""Checks of a calibration: each raises `InputError` with the reason and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.rooms.background import RoomSurface
from depth_pose.rooms.calibration_input import BodyTrack, CameraRecord
from depth_pose.rooms.calibration_match import PairMatch
from depth_pose.rooms.calibration_state import CameraState

Array = NDArray[np.float64]

LEAST_S = 5.0
"""Minimum time that people are seen by both of two cameras (s). Set by hand."""
_LEAST_SHARE = 0.4
"""Minimum time of people that agrees, as a share of the time in which both cameras see somebody. Set by
hand."""
_MORE = 1.8
"""Minimum ratio of the agreeing time to that with one camera mirrored; less is chance, and the inverse ratio
means that one recording is mirrored. Set by hand."""
_COPY_M, _COPY_RAD = 0.01, np.radians(0.3)
"""Two recordings are from one camera if its position (m) and orientation differ by less than this. Set by
hand."""
_THROUGH_M = 0.25
"""A surface this far (m) in front of a camera's depth contradicts it. Set by hand."""
_MOST_CONTRADICTED = 0.25
"""Maximum share of a camera's points of the empty room that another camera contradicts. Set by hand."""
_LINE_M, _PLACE_M = 0.2, 0.3
"""Minimum deviation of people's positions across their main direction and along it (m); less is walking one
line, or standing still. Set by hand."""
_RESOLVED_M = 0.05
"""Maximum deviation of a camera's position by the empty room alone, if that is to suffice (m). Set by
hand."""
_LEAST_POINTS = 100
"""Minimum number of points for that check. Set by hand."""


def check_records(records: Sequence[CameraRecord]) -> None:
    """Check each camera by itself, and that all were there at the same time."""
    if len(records) < 2:
        raise InputError("a calibration needs at least two cameras")
    for record in records:
        if record.upside_down:
            raise InputError(f"{record.name}: {record.upside_down}")
        if not record.stamps_ns:
            raise InputError(f"{record.name} has no frames")
    for i, first in enumerate(records):
        for second in records[i + 1 :]:
            _check_times(first, second)


def _check_times(first: CameraRecord, second: CameraRecord) -> None:
    start = max(first.stamps_ns[0], second.stamps_ns[0])
    end = min(first.stamps_ns[-1], second.stamps_ns[-1])
    if (end - start) * 1e-9 < LEAST_S:
        apart = (second.stamps_ns[0] - first.stamps_ns[0]) * 1e-9
        raise InputError(
            f"{first.name} and {second.name} have {max(end - start, 0) * 1e-9:.1f} s in common "
            f"({second.name} begins {abs(apart):.1f} s {'after' if apart > 0 else 'before'} {first.name}); "
            "record all cameras at the same time, for at least 20 s, with clocks that agree to half a second"
        )


def check_people(name: str, tracks: Sequence[BodyTrack]) -> None:
    """Check that a camera sees somebody."""
    if not tracks:
        raise InputError(f"{name}: nobody is seen; somebody must walk about where two cameras see them")


def check_match(first: str, second: str, match: PairMatch | None) -> str:
    """Return why the people of two cameras do not match; empty if they do."""
    both = f"{first} and {second}"
    if match is None:
        return f"{both} never see somebody at the same time for long enough to be compared"
    if match.mirrored > _MORE * match.seconds and _is_enough(match.mirrored, match.common, match.seconds):
        return (
            f"{both} agree only if one of them is mirrored ({match.mirrored:.0f} s of people's time against "
            f"{match.seconds:.0f} s): one recording is flipped; switch the driver's flip or mirror option off"
        )
    if not _is_enough(match.seconds, match.common, match.mirrored):
        return (
            f"nobody is seen by both {both}: of {match.common:.0f} s in which both see somebody, "
            f"{match.seconds:.0f} s agree, as many as by chance, or less than {LEAST_S:.0f} s; they see "
            "different rooms, or different parts of one"
        )
    return ""


def _is_enough(seconds: float, common: float, by_chance: float) -> bool:
    """Whether the agreeing time is longer than by chance."""
    return seconds >= LEAST_S and (seconds >= _LEAST_SHARE * common or seconds >= _MORE * by_chance)


def check_solution(
    records: Sequence[CameraRecord], states: Sequence[CameraState], surfaces: Sequence[RoomSurface | None]
) -> None:
    """Check that all cameras are different, and that none sees through a surface that another sees."""
    for (first, one, mine), (second, other, theirs) in combinations(
        zip(records, states, surfaces, strict=True), 2
    ):
        T_first_second = np.linalg.inv(one.T_room_camera) @ other.T_room_camera
        if _is_copy(T_first_second):
            raise InputError(
                f"{first.name} and {second.name} are the same recording, or of the same camera: their "
                "people coincide; give recordings of different cameras"
            )
        contradicted = [
            _share_contradicted(first, theirs, T_first_second),
            _share_contradicted(second, mine, np.asarray(np.linalg.inv(T_first_second))),
        ]
        worst = max((share for share in contradicted if np.isfinite(share)), default=0.0)
        if worst > _MOST_CONTRADICTED:
            raise InputError(
                f"{first.name} and {second.name} see different rooms: with the transform by which people "
                f"agree best, one sees through {worst:.0%} of the surfaces that the other sees"
            )


def check_places(name: str, along: float, across: float, room_across: float, room: float) -> None:
    """Check that people walked over an area, or that the empty room makes up for it.

    Parameters
    ----------
    name : str
        The camera's.
    along, across : float
        Deviation of the positions of people that it shares with another camera, along their main direction
        and across it (m).
    room_across, room : float
        Deviation of the camera's position by the empty room alone: across that line and overall (m).
    """
    if across > _LINE_M or (room_across if along > _PLACE_M else room) < _RESOLVED_M:
        return
    what = "walked only one line" if along > _PLACE_M else "stayed in one place"
    raise InputError(
        f"{name}: people whom another camera sees as well {what}, and too little of the empty room is seen "
        "by both; walk to and fro and across, over at least a metre or two"
    )


def _is_copy(T_first_second: Array) -> bool:
    turned = np.arccos(np.clip(0.5 * (np.trace(T_first_second[:3, :3]) - 1.0), -1.0, 1.0))
    moved = np.linalg.norm(T_first_second[:3, 3])
    return bool(turned < _COPY_RAD and moved < _COPY_M)


def _share_contradicted(first: CameraRecord, theirs: RoomSurface | None, T_first_second: Array) -> float:
    """Return the share of the second's surface that the first sees through; NaN where it is not known."""
    if first.background is None or theirs is None:
        return float("nan")
    depth, camera = first.background.depth, first.background.camera
    return share_contradicted(depth, camera, theirs.points @ T_first_second[:3, :3].T + T_first_second[:3, 3])


def share_contradicted(depth: NDArray[np.float32], camera: Camera, points: Array) -> float:
    """Return the share of points that lie in front of what a camera sees, where it should see them.

    Parameters
    ----------
    depth : (H, W) float32
        Metres; 0 where nothing returned.
    camera : Camera
    points : (N, 3) float64
        Surfaces that another camera sees, in this camera's frame, metres.

    Returns
    -------
    float
        NaN where too few of them are in the image.
    """
    points = points[points[:, 2] > _THROUGH_M]
    column, row = np.rint(camera.project(points)).astype(np.int64).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    seen = depth[row[inside], column[inside]]
    known = seen > 0
    if known.sum() < _LEAST_POINTS:
        return float("nan")
    z = points[inside, 2][known]
    return float(np.mean(z < seen[known] * 0.95 - _THROUGH_M))
