"""All people in one file: CSV with a row per joint, and NPZ with arrays over frames and people."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import BONES, JOINTS, JointState, Source
from depth_pose.export.tracks import ARRAYS, Track, Tracks

CSV_COLUMNS = (
    *("frame", "stamp_ns", "time_s", "body_id", "joint", "x", "y", "z", "qx", "qy", "qz", "qw"),
    *("joint_confidence", "joint_state", "confidence", "source", "scale", "frame_id"),
)
"""Columns of a CSV file; lengths in metres, in the frame ``frame_id``; quaternions as in the messages."""


def csv_text(tracks: Tracks) -> str:
    """Build a CSV file's text: a row for every joint of every person in every frame with that person.

    Numbers are written with all digits, so that reading gives the same values.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    rows = [row for track in tracks.people for row in _rows(track, tracks.stamps_ns)]
    rows.sort(key=_frame_of)
    writer.writerows(rows)
    return out.getvalue()


def _frame_of(row: list[Any]) -> int:
    return int(row[0])


def _rows(track: Track, stamps_ns: NDArray[np.int64]) -> Iterator[list[Any]]:
    frames = np.searchsorted(stamps_ns, track.stamps_ns)
    for i in np.flatnonzero(track.present):
        stamp = int(track.stamps_ns[i])
        start = [int(frames[i]), stamp, f"{(stamp - int(stamps_ns[0])) * 1e-9:.9f}", track.body_id]
        end = [track.confidence[i], Source(track.source[i]).name, track.scale[i], track.frame_id]
        for j, name in enumerate(JOINTS):
            state = JointState(track.joint_states[i, j]).name
            where = [repr(float(v)) for v in (*track.positions[i, j], *track.quats_xyzw[i, j])]
            yield [*start, name, *where, track.joint_confidence[i, j], state, *end]


def npz_arrays(tracks: Tracks, T_world_camera: NDArray[np.float64] | None) -> dict[str, NDArray[Any]]:
    """Build a NPZ file's arrays: (T, P, ...), frames first, then people.

    Where a frame lacks a person, ``present`` is false and values are NaN.
    """
    out: dict[str, NDArray[Any]] = {
        "stamps_ns": tracks.stamps_ns,
        "frame_id": np.array(tracks.frame_id),
        "body_ids": np.array([track.body_id for track in tracks.people], np.str_),
        "joints": np.array(JOINTS),
        "bones": np.array(BONES),
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
    return out
