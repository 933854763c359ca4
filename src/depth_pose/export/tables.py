"""All people in one file: CSV with a row per joint, and NPZ with arrays over frames and people."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import BONES, JOINTS, JointState, Source
from depth_pose.core.tables import COLUMNS
from depth_pose.export.tracks import ARRAYS, Track, Tracks


def write_csv(stream: TextIO, tracks: Tracks) -> None:
    """Write a CSV file: a row for every joint of every person in every frame with that person.

    Numbers are written with all digits, so that reading gives the same values. Rows are made while they are
    written: a text of all would take 20 times the memory of the tracks.
    """
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    firsts = [int(np.searchsorted(tracks.stamps_ns, track.stamps_ns[0])) for track in tracks.people]
    for frame, stamp in enumerate(tracks.stamps_ns.tolist()):
        passed_s = f"{(stamp - int(tracks.stamps_ns[0])) * 1e-9:.9f}"
        for track, first in zip(tracks.people, firsts, strict=True):
            i = frame - first
            if 0 <= i < len(track) and track.present[i]:
                writer.writerows(_rows(track, i, [frame, stamp, passed_s, track.body_id]))


def _rows(track: Track, i: int, start: list[Any]) -> Iterator[list[Any]]:
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
