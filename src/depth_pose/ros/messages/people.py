"""Messages of people and their points."""

from __future__ import annotations

import numpy as np
from depth_pose_msgs.msg import JointMeasurement as JointMeasurementMsg
from depth_pose_msgs.msg import People as PeopleMsg
from depth_pose_msgs.msg import TrackedPerson as TrackedPersonMsg
from sensor_msgs.msg import PointCloud2, PointField

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.types import TrackedPerson
from depth_pose.ros.messages.basics import make_header, stamp_to_ns
from depth_pose.ros.messages.checks import FARTHEST_M, check_numbers, check_people, check_shares
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
        people=[_person_to_msg(person.found) for person in people.persons],
    )


def _person_to_msg(person: TrackedPerson) -> TrackedPersonMsg:
    measured = person.measured
    return TrackedPersonMsg(
        label=person.label,
        body_id=person.body_id,
        probability=float(person.probability),
        measured=[] if measured is None else [_measurement_to_msg(measured)],
    )


def _measurement_to_msg(measured: JointMeasurement) -> JointMeasurementMsg:
    return JointMeasurementMsg(
        places=measured.places.ravel(),
        sigma=measured.sigma.ravel(),
        confidence=measured.confidence,
        heels=measured.heels.ravel().tolist(),
        sides=float(measured.sides),
        probability=float(measured.probability),
    )


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
        [_msg_to_person(found) for found in people.people],
        np.array(people.floor),
    )


def warm_up() -> None:
    """Compile the kernels that read and write people."""
    camera, nobody = Camera(4, 3, 4.0, 4.0, 1.5, 1.0), np.full((3, 4, 3), np.nan, np.float32)
    msgs_to_people(*people_to_msgs(see_people(0, "", camera, nobody, np.zeros((3, 4), np.uint8), [])))


def _msg_to_person(msg: TrackedPersonMsg) -> TrackedPerson:
    measured = _msg_to_measurement(msg.measured[0], msg.body_id) if msg.measured else None
    check_shares(msg.body_id, msg.probability)
    return TrackedPerson(msg.label, msg.body_id, msg.probability, measured)


def _msg_to_measurement(msg: JointMeasurementMsg, body_id: str) -> JointMeasurement:
    heels = np.array(msg.heels, np.float32)
    if len(heels) not in (0, 10):
        raise InputError(f"{body_id} has {len(heels)} numbers of heels; two heels have 5 each")
    check_numbers(f"a measured joint of {body_id}", msg.places)
    check_numbers(f"a deviation of {body_id}", msg.sigma)
    check_shares(f"a measured joint of {body_id}", msg.confidence)
    if len(msg.sigma) and not min(msg.sigma) >= 0.0:
        raise InputError(f"{body_id} has the standard deviation {min(msg.sigma):g}; it is not below 0")
    check_numbers(f"a heel of {body_id}", heels)
    for name in ("sides", "probability"):
        if not 0.0 <= getattr(msg, name) <= 1.0:
            raise InputError(f"the {name} of {body_id} is {getattr(msg, name)}; it is 0 to 1")
    return JointMeasurement(
        places=msg.places.reshape(-1, 3),
        sigma=msg.sigma.reshape(-1, 2),
        confidence=msg.confidence,
        heels=heels.reshape(-1, 5),
        sides=msg.sides,
        probability=msg.probability,
    )
