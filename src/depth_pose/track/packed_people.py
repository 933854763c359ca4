"""The people of a frame as few bytes, about 100 kB a person, for files and other processes."""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.types import TrackedPerson
from depth_pose.track.person_view import FramePeople, see_people


class PackedPeople(NamedTuple):
    """`FramePeople` without data that can be recomputed.

    Attributes
    ----------
    stamp_ns : int
    frame_id : str
    camera : Camera
    at : (N,) int64
        Pixels with a point, by their number.
    points : (N, 3) float32
        Camera frame, metres.
    labels : bytes
        Compressed.
    found : tuple of TrackedPerson
    floor : (4,) float64
    """

    stamp_ns: int
    frame_id: str
    camera: Camera
    at: NDArray[np.int64]
    points: NDArray[np.float32]
    labels: bytes
    found: tuple[TrackedPerson, ...]
    floor: NDArray[np.float64]


def pack_people(people: FramePeople) -> PackedPeople:
    """Pack people, without data that `unpack_people` recomputes."""
    at = np.flatnonzero(np.isfinite(people.points[..., 2]))
    points = people.points.reshape(-1, 3)[at]
    labels = zlib.compress(people.labels.tobytes(), 1)
    found = tuple(_without_mask(person.found) for person in people.persons)
    return PackedPeople(
        people.stamp_ns, people.frame_id, people.camera, at, points, labels, found, people.floor
    )


def _without_mask(found: TrackedPerson) -> TrackedPerson:
    measured = found.measured
    return found if measured is None else replace(found, measured=measured.without_mask())


def unpack_people(packed: PackedPeople) -> FramePeople:
    """Rebuild the people, bit for bit as before."""
    camera = packed.camera
    labels = np.frombuffer(zlib.decompress(packed.labels), np.uint8).reshape(camera.height, camera.width)
    points = np.full((*labels.shape, 3), np.nan, np.float32)
    points.reshape(-1, 3)[packed.at] = packed.points
    return see_people(packed.stamp_ns, packed.frame_id, camera, points, labels, packed.found, packed.floor)
