"""Messages of people: between the nodes as packed arrays, and for everybody as a cloud with labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from depth_pose_msgs.msg import Packed
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.packing import pack, unpack
from depth_pose.ros.messages.basics import make_header, stamp_to_ns
from depth_pose.ros.messages.checks import check_numbers, check_people, check_shares
from depth_pose.track._person_kernels import pack_points
from depth_pose.track.packed_people import PEOPLE_KINDS, people_arrays, people_of
from depth_pose.track.person_view import MIN_POINTS, FramePeople, see_people
from depth_pose.track.tracked_person import TrackedPerson

POINT_DTYPE = np.dtype(
    {
        "names": ["x", "y", "z", "label"],
        "formats": ["<f4", "<f4", "<f4", "u1"],
        "offsets": [0, 4, 8, 12],
        "itemsize": 16,
    }
)
"""One point of ``/depth_pose/points``: x, y, z in metres, label, three bytes of padding."""

_FIELDS = [
    PointField(name="x", offset=0, datatype=PointField.FLOAT32, count=1),
    PointField(name="y", offset=4, datatype=PointField.FLOAT32, count=1),
    PointField(name="z", offset=8, datatype=PointField.FLOAT32, count=1),
    PointField(name="label", offset=12, datatype=PointField.UINT8, count=1),
]
"""The same as fields of a `PointCloud2`."""

Arrays = list[NDArray[Any]]


def people_to_cloud(people: FramePeople) -> PointCloud2:
    """Build an organised ``PointCloud2`` of 16 bytes a point: x, y, z float32, label uint8.

    The data is assigned as ``bytes``: a numpy array would take 50 times as long.
    """
    height, width = people.labels.shape
    packed = np.empty((height, width, 4), "<f4")
    pack_points(people.points, people.labels, packed, packed.view(np.uint8))
    return PointCloud2(
        header=make_header(people.stamp_ns, people.frame_id),
        height=height,
        width=width,
        fields=_FIELDS,
        is_bigendian=False,
        point_step=POINT_DTYPE.itemsize,
        row_step=POINT_DTYPE.itemsize * width,
        data=packed.tobytes(),
        is_dense=False,
    )


def people_to_msg(people: FramePeople, more: Sequence[NDArray[Any]] = ()) -> Packed:
    """Build the message of a frame's people, with further arrays that describe them."""
    message = Packed(header=make_header(people.stamp_ns, people.frame_id))
    message.data.frombytes(pack([*people_arrays(people), *more]))
    return message


def msg_to_people(message: Packed) -> FramePeople:
    """Return the people of a message.

    Raises
    ------
    InputError
        If a number or an id is not valid.
    """
    return read_people(message, ())[0]


def read_people(message: Packed, more: Sequence[np.dtype[Any]]) -> tuple[FramePeople, Arrays]:
    """Return the people of a message, and its further arrays, of the types ``more``.

    Raises
    ------
    InputError
        If a number or an id is not valid.
    """
    arrays = unpack(memoryview(message.data).cast("B"), [*PEOPLE_KINDS, *more])
    frame, records = arrays[:2]
    if len(frame) != 1:
        raise InputError(f"the data has {len(frame)} frames, not one")
    ids = text_of(records["body_id"])
    check_people("people", ids)
    check_numbers("the camera", frame["grid"], 1e6)
    if not (frame["grid"][0, :4] >= 1.0).all():
        raise InputError(f"the camera is {', '.join(f'{n:g}' for n in frame['grid'][0])}")
    check_numbers("the floor", frame["floor"], 1e6)
    _check_records(records)
    header = message.header
    return people_of(arrays[:4], stamp_to_ns(header.stamp), header.frame_id), arrays[4:]


def _check_records(records: NDArray[Any]) -> None:
    check_shares("a person", records["probability"])
    check_numbers("a measured joint", records["places"])
    check_numbers("a deviation", records["sigma"])
    check_numbers("a heel", records["heels"])
    check_shares("a measured joint", records["confidence"])
    check_shares("the sides of a measurement", records["sides"])
    check_shares("a measurement", records["measured_probability"])
    if (records["sigma"] < 0.0).any():
        raise InputError(f"a standard deviation is {records['sigma'].min():g}; it is not below 0")
    odd = [n for n in records["heel_count"].tolist() if n not in (0, 2)]
    if odd:
        raise InputError(f"a person has {odd[0]} heels")


def text_of(texts: NDArray[np.bytes_]) -> list[str]:
    """Return texts of a record; bytes that are no UTF-8 become �."""
    return [text.decode(errors="replace") for text in texts.tolist()]


def warm_up() -> None:
    """Compile the kernels that read and write people."""
    side = round(MIN_POINTS**0.5) + 1
    camera, labels = Camera(side, side, 4.0, 4.0, 1.5, 1.0), np.ones((side, side), np.uint8)
    found = [TrackedPerson(1, "body_1", 1.0)]
    people = see_people(0, "", camera, np.ones((side, side), np.float32), labels, found)
    msg_to_people(people_to_msg(people))
    people_to_cloud(people)
