"""All people in one file: CSV of joints or angles, JSON, and NPZ."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator
from itertools import count
from typing import Any, TextIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angle_definitions import JOINT_ANGLES
from depth_pose.body.joint_angles import measure_angles
from depth_pose.core.skeleton import BONES, JOINTS, JointState, Source
from depth_pose.core.tables import COLUMNS
from depth_pose.export.tracks import ARRAYS, Track, Tracks

_Measured = TypeVar("_Measured")

ANGLE_KEYS = ("frame", "stamp_ns", "time_s", "body_id")
"""First columns of a CSV file of joint angles; then come, for each, its degrees and its deviation."""


def write_csv(stream: TextIO, parts: Iterable[Tracks]) -> None:
    """Write a CSV file: a row for every joint of every person in every frame with that person.

    Numbers are written with all digits, so that reading gives the same values.

    Parameters
    ----------
    stream : text file
    parts : iterable of Tracks
        The recording, whole or in successive parts, which are written as they come.
    """
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for frame, stamp, passed_s, people in _frames(parts, lambda track: None):
        for track, i, _ in people:
            writer.writerows(_rows(track, i, [frame, stamp, f"{passed_s:.9f}", track.body_id]))


def write_angles(stream: TextIO, parts: Iterable[Tracks], up: NDArray[np.float64] | None) -> None:
    """Write a CSV file of joint angles: a row for every person in every frame with that person.

    An angle and its deviation (``..._sd``) are empty where it is not measured.

    Parameters
    ----------
    stream : text file
    parts : iterable of Tracks
        As of `write_csv`.
    up : (3,), optional
        As for `depth_pose.body.joint_angles.joint_angles`.
    """
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*ANGLE_KEYS, *(name + part for name in JOINT_ANGLES for part in ("", "_sd"))])
    for frame, stamp, passed_s, people in _frames(parts, lambda track: _angles(track, up)):
        for track, i, (degrees, deviations) in people:
            pairs = np.stack([degrees[i], deviations[i]], axis=1).ravel()
            row = ["" if not np.isfinite(value) else f"{value:.3f}" for value in pairs]
            writer.writerow([frame, stamp, f"{passed_s:.9f}", track.body_id, *row])


def write_json(
    stream: TextIO, parts: Iterable[Tracks], frame_id: str, up: NDArray[np.float64] | None
) -> None:
    """Write a JSON file: names, then a list of frames, each with its people; null where a value is not known.

    Parameters
    ----------
    stream : text file
    parts : iterable of Tracks
        As of `write_csv`.
    frame_id : str
        Name of the frame that positions are in.
    up : (3,), optional
        As for `depth_pose.body.joint_angles.joint_angles`.
    """
    head = {"frame_id": frame_id, "joints": JOINTS, "bones": BONES, "angles": JOINT_ANGLES}
    stream.write(json.dumps(head)[:-1] + ', "frames": [')
    for frame, stamp, passed_s, people in _frames(parts, lambda track: _angles(track, up)):
        shown = [_plain_person(track, i, angles) for track, i, angles in people]
        line = {"stamp_ns": stamp, "time_s": round(passed_s, 9), "people": shown}
        stream.write(("," if frame else "") + "\n" + json.dumps(line, allow_nan=False))
    stream.write("\n]}\n")


def _plain_person(track: Track, i: int, angles: tuple[NDArray[np.float64], ...]) -> dict[str, Any]:
    return {
        "body_id": track.body_id,
        "confidence": _plain(track.confidence[i]),
        "source": Source(track.source[i]).name,
        "scale": _plain(track.scale[i]),
        "positions": _plain(track.positions[i]),
        "quats_xyzw": _plain(track.quats_xyzw[i]),
        "joint_confidence": _plain(track.joint_confidence[i]),
        "joint_states": [JointState(state).name for state in track.joint_states[i]],
        "angles_deg": _plain(np.round(angles[0][i], 3)),
        "angle_deviations_deg": _plain(np.round(angles[1][i], 3)),
    }


def _plain(values: Any) -> Any:
    """Return numbers as lists, None in place of NaN and infinity."""
    if np.ndim(values):
        return [_plain(value) for value in values]
    return float(values) if np.isfinite(values) else None


def _angles(track: Track, up: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], ...]:
    return measure_angles(
        track.positions, track.quats_xyzw, track.joint_confidence, track.joint_states, track.covariances, up
    )


def _frames(
    parts: Iterable[Tracks], measure: Callable[[Track], _Measured]
) -> Iterator[tuple[int, int, float, list[tuple[Track, int, _Measured]]]]:
    """Yield number, stamp and seconds of each frame, and its people: track, row in it, and its measures."""
    number, start_ns = count(), None
    for part in parts:
        people = [
            (track, int(np.searchsorted(part.stamps_ns, track.stamps_ns[0])), measure(track))
            for track in part.people
        ]
        for row, stamp in enumerate(part.stamps_ns.tolist()):
            start_ns = stamp if start_ns is None else start_ns
            there = [
                (track, row - first, measured)
                for track, first, measured in people
                if 0 <= row - first < len(track) and track.present[row - first]
            ]
            yield next(number), stamp, (stamp - start_ns) * 1e-9, there


def _rows(track: Track, i: int, start: list[Any]) -> Iterator[list[Any]]:
    end = [track.confidence[i], Source(track.source[i]).name, track.scale[i], track.frame_id]
    for j, name in enumerate(JOINTS):
        state = JointState(track.joint_states[i, j]).name
        where = [repr(float(v)) for v in (*track.positions[i, j], *track.quats_xyzw[i, j])]
        yield [*start, name, *where, track.joint_confidence[i, j], state, *end]


def npz_arrays(
    tracks: Tracks, up: NDArray[np.float64] | None, T_world_camera: NDArray[np.float64] | None
) -> dict[str, NDArray[Any]]:
    """Build a NPZ file's arrays: (T, P, ...), frames first, then people.

    Where a frame lacks a person, ``present`` is false and values are NaN.
    """
    out: dict[str, NDArray[Any]] = {
        "stamps_ns": tracks.stamps_ns,
        "frame_id": np.array(tracks.frame_id),
        "body_ids": np.array([track.body_id for track in tracks.people], np.str_),
        "joints": np.array(JOINTS),
        "bones": np.array(BONES),
        "angle_names": np.array(JOINT_ANGLES),
    }
    if T_world_camera is not None:
        out["T_world_camera"] = T_world_camera
    shape = (len(tracks.stamps_ns), len(tracks.people))
    if not tracks.people:
        return out
    for name in ARRAYS:
        one = getattr(tracks.people[0], name)
        absent = {"joint_states": int(JointState.LOST), "source": int(Source.LOST), "present": False}
        values = np.full((*shape, *one.shape[1:]), absent.get(name, np.nan), one.dtype)
        for person, track in enumerate(tracks.people):
            values[np.searchsorted(tracks.stamps_ns, track.stamps_ns), person] = getattr(track, name)
        out[name] = values
    degrees = np.full((*shape, len(JOINT_ANGLES)), np.nan)
    deviations = np.full_like(degrees, np.inf)
    for person, track in enumerate(tracks.people):
        rows = np.searchsorted(tracks.stamps_ns, track.stamps_ns)
        degrees[rows, person], deviations[rows, person] = _angles(track, up)
    return out | {"angles_deg": degrees, "angle_deviations_deg": deviations}
