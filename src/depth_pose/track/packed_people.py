"""The people of a frame as one block of bytes, for files and other processes.

The window of each person is stored, from which all other parts of a `PersonView` are recomputed: about 60 kB
a person, or a tenth of it compressed.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.rendered_depth import Observation
from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.labels import PERSON
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.packing import pack, unpack
from depth_pose.core.skeleton import JOINTS
from depth_pose.track import _person_kernels as kernels
from depth_pose.track.person_view import MIN_POINTS, FramePeople, PersonView
from depth_pose.track.tracked_person import TrackedPerson

_FRAME = np.dtype([("grid", "<f8", 6), ("floor", "<f8", 4)])
"""The camera's fields in their order, and the floor."""

PERSON_RECORD = np.dtype(
    [
        ("label", "u1"),
        ("body_id", "S64"),
        ("probability", "<f8"),
        ("is_measured", "?"),
        ("places", "<f4", (len(JOINTS), 3)),
        ("sigma", "<f4", (len(JOINTS), 2)),
        ("confidence", "<f4", len(JOINTS)),
        ("heel_count", "u1"),
        ("heels", "<f4", (2, 5)),
        ("sides", "<f8"),
        ("measured_probability", "<f8"),
        ("box", "<i4", 4),
        ("is_cut_below", "?"),
        ("is_cut_beside", "?"),
        ("is_calm", "?"),
    ]
)
"""One person; ``box`` is top, left, height and width of the window."""

PEOPLE_KINDS = (_FRAME, PERSON_RECORD, np.dtype("<f4"), np.dtype("u1"))
"""Types of the arrays of `people_arrays`."""

FARTHEST_M = 1e3
"""Maximum depth that is accepted (m); no depth sensor sees farther."""


class PackedPeople(NamedTuple):
    """`FramePeople` without data that can be recomputed, compressed."""

    stamp_ns: int
    frame_id: str
    data: bytes


def pack_people(people: FramePeople) -> PackedPeople:
    """Pack people, without data that `unpack_people` recomputes, and without the frame's pixels."""
    return PackedPeople(people.stamp_ns, people.frame_id, zlib.compress(pack(people_arrays(people)), 1))


def unpack_people(packed: PackedPeople) -> FramePeople:
    """Rebuild the people, bit for bit as before."""
    data = zlib.decompress(packed.data)
    return people_of(unpack(data, PEOPLE_KINDS), packed.stamp_ns, packed.frame_id)


def people_arrays(people: FramePeople) -> list[NDArray[Any]]:
    """Return the arrays that describe the people of a frame, for `depth_pose.core.packing.pack`."""
    frame, records = np.zeros(1, _FRAME), np.zeros(len(people.persons), PERSON_RECORD)
    frame["grid"], frame["floor"] = people.camera, people.floor
    for record, person in zip(records, people.persons, strict=True):
        _fill(record, person)
    depths = [person.full.depth.ravel() for person in people.persons]
    labels = [person.full.labels.ravel() for person in people.persons]
    none = np.zeros(0)
    return [
        frame,
        records,
        np.concatenate([none.astype("<f4"), *depths]),
        np.concatenate([none.astype("u1"), *labels]),
    ]


def _fill(record: np.void, person: PersonView) -> None:
    found, window, measured = person.found, person.full.camera, person.measured
    top, left = round(person.camera.cy - window.cy), round(person.camera.cx - window.cx)
    record["label"], record["body_id"], record["probability"] = (
        found.label,
        found.body_id.encode(),
        found.probability,
    )
    record["box"] = top, left, window.height, window.width
    record["is_cut_below"], record["is_cut_beside"] = person.is_cut_below, person.is_cut_beside
    record["is_calm"] = found.is_calm
    if measured is not None:
        record["is_measured"] = True
        record["places"], record["sigma"] = measured.places, measured.sigma
        record["confidence"] = measured.confidence
        record["heel_count"] = len(measured.heels)
        record["heels"][: len(measured.heels)] = measured.heels
        record["sides"], record["measured_probability"] = measured.left_right_confidence, measured.probability


def people_of(arrays: Sequence[NDArray[Any]], stamp_ns: int, frame_id: str) -> FramePeople:
    """Rebuild the people from `people_arrays`.

    Raises
    ------
    InputError
        If a window does not fit its grid, or has a depth or a label that is none.
    """
    frame, records, depths, labels = arrays
    width, height, fx, fy, cx, cy = frame["grid"][0].tolist()
    camera = Camera(int(width), int(height), fx, fy, cx, cy)
    floor = frame["floor"][0].astype(np.float64)
    persons, at = [], 0
    sizes = records["box"].astype(np.int64)
    pixels = int((sizes[:, 2] * sizes[:, 3]).sum())
    if not len(depths) == len(labels) == pixels:
        raise InputError(f"the windows have {pixels} pixels, {len(depths)} depths and {len(labels)} labels")
    for record in records:
        top, left, rows, columns = record["box"].tolist()
        end = at + rows * columns
        if not (0 <= top < top + rows <= height and 0 <= left < left + columns <= width):
            raise InputError(f"a window of {columns} x {rows} at {left}, {top} of {width:g} x {height:g}")
        window = Observation(
            depths[at:end].reshape(rows, columns),
            labels[at:end].reshape(rows, columns),
            camera.cropped(left, top, columns, rows),
        )
        persons.append(_person_of(record, window, camera, stamp_ns, frame_id, floor))
        at = end
    empty = np.zeros((0, 0), np.float32)
    return FramePeople(stamp_ns, frame_id, camera, empty, empty.astype(np.uint8), tuple(persons), floor)


def _person_of(
    record: np.void,
    window: Observation,
    camera: Camera,
    stamp_ns: int,
    frame_id: str,
    floor: NDArray[np.float64],
) -> PersonView:
    top, left = record["box"].tolist()[:2]
    points = np.empty((int(np.count_nonzero(window.labels == PERSON)), 3))
    count = kernels.window_points(window.depth, window.labels, camera, top, left, FARTHEST_M, points)
    body_id = record["body_id"].decode()
    if count < MIN_POINTS:
        raise InputError(f"{body_id} has {count} points within {FARTHEST_M:g} m; a person has {MIN_POINTS}")
    found = TrackedPerson(
        int(record["label"]),
        body_id,
        float(record["probability"]),
        _measurement_of(record),
        bool(record["is_calm"]),
    )
    is_cut_below, is_cut_beside = bool(record["is_cut_below"]), bool(record["is_cut_beside"])
    return PersonView(stamp_ns, frame_id, found, camera, points, window, is_cut_below, is_cut_beside, floor)


def _measurement_of(record: np.void) -> JointMeasurement | None:
    if not record["is_measured"]:
        return None
    return JointMeasurement(
        places=record["places"].copy(),
        sigma=record["sigma"].copy(),
        confidence=record["confidence"].copy(),
        heels=record["heels"][: record["heel_count"]].copy(),
        left_right_confidence=float(record["sides"]),
        probability=float(record["measured_probability"]),
    )
