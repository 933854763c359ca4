"""Messages of people and their points."""

from __future__ import annotations

from typing import Any

import numpy as np
from depth_pose_msgs.msg import FoundPerson as FoundPersonMsg
from depth_pose_msgs.msg import People as PeopleMsg
from sensor_msgs.msg import PointCloud2, PointField

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINTS
from depth_pose.core.types import TrackedPerson
from depth_pose.ros.messages.basics import make_header, stamp_to_ns
from depth_pose.ros.messages.checks import FARTHEST_M, check_numbers, check_people
from depth_pose.track._person_kernels import pack_points, unpack_points
from depth_pose.track.person_view import FramePeople, see_people

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


def people_to_msgs(people: FramePeople) -> tuple[PointCloud2, PeopleMsg]:
    """Build an organised ``PointCloud2`` of 16 bytes a point (x, y, z float32, label uint8), and its people.

    The data is assigned as ``bytes``: a numpy array would take 50 times as long.
    """
    height, width = people.labels.shape
    packed = np.empty((height, width, 4), "<f4")
    pack_points(people.points, people.labels, packed, packed.view(np.uint8))
    header = make_header(people.stamp_ns, people.frame_id)
    cloud = PointCloud2(
        header=header,
        height=height,
        width=width,
        fields=_FIELDS,
        is_bigendian=False,
        point_step=POINT_DTYPE.itemsize,
        row_step=POINT_DTYPE.itemsize * width,
        data=packed.tobytes(),
        is_dense=False,
    )
    return cloud, PeopleMsg(
        header=header,
        **people.camera._asdict(),
        floor=people.floor.tolist(),
        people=[_found_to_msg(person.found) for person in people.persons],
    )


def _found_to_msg(found: TrackedPerson) -> FoundPersonMsg:
    return FoundPersonMsg(
        label=found.label,
        body_id=found.body_id,
        probability=float(found.probability),
        **_measurement_to_fields(found.measured),
    )


def _measurement_to_fields(measured: JointMeasurement | None) -> dict[str, Any]:
    if measured is None:
        return {}
    return {
        "proposals": measured.places.ravel().tolist(),
        "proposal_confidence": measured.confidence.tolist(),
        "proposal_sigma": measured.sigma.ravel().tolist(),
        "heels": measured.heels.ravel().tolist(),
        "sides": float(measured.sides),
    }


def msgs_to_people(points: PointCloud2, people: PeopleMsg) -> FramePeople:
    """Convert the messages of `people_to_msgs` back to people.

    Raises
    ------
    InputError
        If the layout differs, the data is too short, or a point is invalid.
    """
    layout = [(f.name, f.offset, f.datatype) for f in points.fields]
    if layout != [(f.name, f.offset, f.datatype) for f in _FIELDS] or points.point_step != 16:
        found = ", ".join(f"{name} at {offset}" for name, offset, _ in layout)
        raise InputError(
            f"the cloud's fields are {found or 'none'} in {points.point_step} bytes; people's points have "
            "x, y, z (float32) and label (uint8) in 16: subscribe to the denoise node's points"
        )
    size = points.height * points.width * 16
    if points.is_bigendian or len(points.data) != size or points.row_step != 16 * points.width:
        raise InputError(
            f"the people's points have {len(points.data)} bytes of data, not the {size} little-endian ones "
            f"of their {points.width} x {points.height} points"
        )
    if (people.width, people.height) != (points.width, points.height) or not people.fx >= 1.0 <= people.fy:
        raise InputError(
            f"the people message speaks of a grid of {people.width} x {people.height} with focal lengths "
            f"{people.fx:g}, {people.fy:g}; the points have {points.width} x {points.height}"
        )
    check_numbers("the camera", [people.fx, people.fy, people.cx, people.cy], 1e6)
    check_numbers("the floor", people.floor, 1e6)
    check_people("people", [found.body_id for found in people.people])
    shape = points.height, points.width
    octets = np.frombuffer(points.data, np.uint8).reshape(*shape, 16)
    xyz, labels, is_person = (
        np.empty((*shape, 3), np.float32),
        np.empty(shape, np.uint8),
        np.zeros(256, np.bool_),
    )
    is_person[[found.label for found in people.people]] = True
    bad = unpack_points(octets.view("<f4"), octets, is_person, FARTHEST_M, xyz, labels)
    if bad >= 0:
        check_numbers("a person's points", xyz.reshape(-1, 3)[bad])
    return see_people(
        stamp_to_ns(points.header.stamp),
        points.header.frame_id,
        Camera(people.width, people.height, people.fx, people.fy, people.cx, people.cy),
        xyz,
        labels,
        [_msg_to_found(found) for found in people.people],
        np.array(people.floor),
    )


def warm_up() -> None:
    """Compile the kernels that read and write people."""
    camera, nobody = Camera(4, 3, 4.0, 4.0, 1.5, 1.0), np.full((3, 4, 3), np.nan, np.float32)
    msgs_to_people(*people_to_msgs(see_people(0, "", camera, nobody, np.zeros((3, 4), np.uint8), [])))


def _msg_to_found(msg: FoundPersonMsg) -> TrackedPerson:
    return TrackedPerson(msg.label, msg.body_id, msg.probability, _msg_to_measurement(msg))


def _msg_to_measurement(msg: FoundPersonMsg) -> JointMeasurement | None:
    confidence = np.array(msg.proposal_confidence, np.float32)
    places, sigma = np.array(msg.proposals, np.float32), np.array(msg.proposal_sigma, np.float32)
    count = len(confidence)
    if (len(places), len(sigma)) != (3 * count, 2 * count) or count not in (0, len(JOINTS)):
        raise InputError(
            f"{msg.body_id} has {len(places)} numbers of proposed joints, {len(sigma)} of deviations "
            f"and {count} confidences; each of {len(JOINTS)} joints has 3, 2 and 1"
        )
    check_numbers(f"the proposed joints of {msg.body_id}", places)
    heels = np.array(msg.heels, np.float32)
    if len(heels) not in (0, 10):
        raise InputError(f"{msg.body_id} has {len(heels)} numbers of heels; two heels have 5 each")
    check_numbers(f"the standard deviations of {msg.body_id}", sigma)
    check_numbers(f"the heels of {msg.body_id}", heels)
    if not 0.0 <= msg.sides <= 1.0:
        raise InputError(f"the sides of {msg.body_id} have the probability {msg.sides}; it is 0 to 1")
    if not count:
        return None
    return JointMeasurement(
        places.reshape(-1, 3), sigma.reshape(-1, 2), confidence, heels.reshape(-1, 5), msg.sides
    )
