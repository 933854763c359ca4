"""Between ROS messages and the core's types; nothing is computed here but layout.

What the nodes hand to each other comes back bit for bit: clouds stay float32, transforms and
joint positions float64. The few float32 fields of ``depth_pose_msgs/Skeleton`` (confidence,
residual, scale and the joints' confidence) hold values that the core has already rounded.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from depth_pose_msgs.msg import Candidate as CandidateMsg
from depth_pose_msgs.msg import FittedArray, PoseMatchArray, SkeletonArray
from depth_pose_msgs.msg import FoundPerson as FoundPersonMsg
from depth_pose_msgs.msg import Joint as JointMsg
from depth_pose_msgs.msg import People as PeopleMsg
from depth_pose_msgs.msg import PoseMatch as PoseMatchMsg
from depth_pose_msgs.msg import Skeleton as SkeletonMsg
from geometry_msgs.msg import Point, Quaternion, Transform, Vector3
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2, PointField
from std_msgs.msg import Header

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointState, Source
from depth_pose.core.types import BUILD_SIZE, Candidate, DepthFrame, Fitted, FoundPerson, PoseMatch, Skeleton
from depth_pose.io.calibration import camera_from_info, rectify_depth
from depth_pose.io.clouds import decode_points, frame_from_cloud
from depth_pose.io.compressed import decode_compressed_depth
from depth_pose.io.decode import decode_depth
from depth_pose.people.person import People, see_people

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
_NS_PER_S = 1_000_000_000
_STAMP = struct.Struct("<xB2xiI")
"""How a message that begins with a header begins: whether it is little-endian, seconds, nanoseconds."""

_STATES = frozenset(map(int, JointState))

_BODY_ID = re.compile("[A-Za-z0-9_]{1,64}")
"""What ROS takes in names of topics and tf2 in those of frames; the denoise node's are ``body_NUMBER``."""

MOST_PEOPLE = 255
"""People of one frame: their labels in the points are 1 to 255."""

_FARTHEST_M = 1e3
"""Metres; no depth sensor sees farther, and numbers beyond overflow where they are squared."""


def stamp_to_ns(stamp: Time) -> int:
    """Nanoseconds of a message's stamp."""
    return int(stamp.sec) * _NS_PER_S + int(stamp.nanosec)


def first_stamp_ns(raw: bytes) -> int:
    """Give the stamp of a message that begins with a header, of its bytes (CDR)."""
    if len(raw) < _STAMP.size:
        raise InputError(f"{len(raw)} bytes hold no header")
    little, sec, nanosec = _STAMP.unpack_from(raw)
    if not little:
        raise InputError("it is not little-endian")
    return int(sec) * _NS_PER_S + int(nanosec)


def ns_to_stamp(stamp_ns: int) -> Time:
    """Stamp of a message from nanoseconds."""
    return Time(sec=stamp_ns // _NS_PER_S, nanosec=stamp_ns % _NS_PER_S)


def make_header(stamp_ns: int, frame_id: str) -> Header:
    """Header with the given stamp and frame."""
    return Header(stamp=ns_to_stamp(stamp_ns), frame_id=frame_id)


# --- people and their points ---------------------------------------------------------------


def people_to_msgs(people: People) -> tuple[PointCloud2, PeopleMsg]:
    """Organised ``PointCloud2`` of 16 bytes a point (x, y, z float32, label uint8), and who is in it.

    The data go in as ``bytes``: assigning a numpy array to the field costs 50 times as much.
    """
    height, width = people.labels.shape
    packed = np.zeros((height, width, 4), "<f4")
    packed[..., :3] = people.points
    packed.view(np.uint8)[..., 12] = people.labels
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
        people=[_found_to_msg(person.found) for person in people.persons],
    )


def _found_to_msg(found: FoundPerson) -> FoundPersonMsg:
    return FoundPersonMsg(
        label=found.label,
        body_id=found.body_id,
        probability=float(found.probability),
        proposals=found.proposals.ravel().tolist(),
        proposal_confidence=found.proposal_confidence.tolist(),
    )


def msgs_to_people(points: PointCloud2, people: PeopleMsg) -> People:
    """People of the messages that `people_to_msgs` made.

    Raises
    ------
    InputError
        If the layout is another one, the data are shorter than they should be, or a point is no place.
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
    _sane("the camera", [people.fx, people.fy, people.cx, people.cy], 1e6)
    check_people("people", [found.body_id for found in people.people])
    packed = np.frombuffer(points.data, np.uint8).reshape(points.height, points.width, 16)
    xyz = np.ascontiguousarray(packed[..., :12]).view("<f4")
    labels = np.ascontiguousarray(packed[..., 12])
    _sane("a person's points", xyz[np.isin(labels, [found.label for found in people.people])])
    return see_people(
        stamp_to_ns(points.header.stamp),
        points.header.frame_id,
        Camera(people.width, people.height, people.fx, people.fy, people.cx, people.cy),
        xyz.astype(np.float32, copy=False),
        labels,
        [_msg_to_found(found) for found in people.people],
    )


def _msg_to_found(msg: FoundPersonMsg) -> FoundPerson:
    confidence = np.array(msg.proposal_confidence, np.float32)
    proposals = np.array(msg.proposals, np.float32)
    if len(proposals) != 3 * len(confidence):
        raise InputError(
            f"{msg.body_id} has {len(proposals)} numbers of proposed joints, not {3 * len(confidence)}"
        )
    _sane(f"the proposed joints of {msg.body_id}", proposals)
    return FoundPerson(msg.label, msg.body_id, msg.probability, proposals.reshape(-1, 3), confidence)


def check_people(what: str, body_ids: Sequence[str]) -> None:
    """Refuse a message of people that are none, before they are read.

    There are no more than labels, none of them twice, and frames and topics can be named by their ids.

    Raises
    ------
    InputError
    """
    if len(body_ids) > MOST_PEOPLE:
        raise InputError(f"the {what} are of {len(body_ids)} people; at most {MOST_PEOPLE} can be in a frame")
    if len(set(body_ids)) < len(body_ids):
        twice = next(b for i, b in enumerate(body_ids) if b in body_ids[:i])
        raise InputError(f"the {what} have {twice!r} twice")
    odd = [b for b in body_ids if not _BODY_ID.fullmatch(b)]
    if odd:
        raise InputError(
            f"the {what} have the id {odd[0][:80]!r}; an id is of letters, digits and _, 1 to 64 of them"
        )


def _sane(what: str, numbers: ArrayLike, most: float = _FARTHEST_M) -> NDArray[np.float64]:
    """Give numbers as an array.

    Raises
    ------
    InputError
        If one is NaN or so large that no sensor can have meant it.
    """
    array = np.asarray(numbers, np.float64)
    if not (np.abs(array) <= most).all():
        odd = array.ravel()[~(np.abs(array.ravel()) <= most)][0]
        raise InputError(f"{what} has the number {odd:g}")
    return array


# --- what sensors publish ------------------------------------------------------------------


def image_to_frame(msg: Image | CompressedImage, info: CameraInfo) -> DepthFrame:
    """Depth frame of an image, compressed or not, and its ``CameraInfo``, without the lens' distortion.

    Raises
    ------
    InputError
        If the encoding, the size or the camera cannot be used.
    """
    if isinstance(msg, CompressedImage):
        depth = decode_compressed_depth(msg.format, memoryview(msg.data))
    else:
        depth = decode_depth(
            memoryview(msg.data), msg.height, msg.width, msg.step, msg.encoding, bool(msg.is_bigendian)
        )
    camera = camera_from_info(info.k, info.d, info.width, info.height, info.distortion_model)
    return DepthFrame(
        stamp_ns=stamp_to_ns(msg.header.stamp),
        frame_id=msg.header.frame_id,
        depth=rectify_depth(depth, camera, info.d, info.distortion_model),
        camera=camera,
    )


def msg_to_frame(msg: PointCloud2) -> DepthFrame:
    """Depth frame of a sensor's point cloud in its optical frame, organised or not.

    Raises
    ------
    InputError
        If the cloud has no usable coordinates.
    """
    points = decode_points(
        memoryview(msg.data),
        msg.height,
        msg.width,
        msg.point_step,
        msg.row_step,
        {f.name: (f.offset, f.datatype) for f in msg.fields},
        bool(msg.is_bigendian),
    )
    return frame_from_cloud(points, stamp_to_ns(msg.header.stamp), msg.header.frame_id)


# --- match and skeleton --------------------------------------------------------------------


def matches_to_msg(matches: Sequence[PoseMatch], people: People) -> PoseMatchArray:
    """Message of the matches of a frame's people."""
    return PoseMatchArray(
        header=make_header(people.stamp_ns, people.frame_id),
        matches=[
            PoseMatchMsg(
                body_id=m.body_id,
                bank_id=m.bank_id,
                scale=float(m.scale),
                candidates=[_candidate_to_msg(c) for c in m.candidates],
            )
            for m in matches
        ],
    )


def _candidate_to_msg(candidate: Candidate) -> CandidateMsg:
    x, y, z = candidate.translation.tolist()
    return CandidateMsg(
        exemplar=int(candidate.exemplar),
        view=int(candidate.view),
        transform=Transform(
            translation=Vector3(x=x, y=y, z=z), rotation=_quaternion(candidate.quat_xyzw.tolist())
        ),
        distance=float(candidate.distance),
        score=float(candidate.score),
    )


def msg_to_matches(msg: PoseMatchArray) -> tuple[PoseMatch, ...]:
    """Give the matches of a message, equal to those that were sent.

    Raises
    ------
    InputError
        If a number is none that a match can have.
    """
    check_people("matches", [m.body_id for m in msg.matches])
    for m in msg.matches:
        if m.candidates and not 0.01 < m.scale < 100.0:
            raise InputError(f"the scale of {m.body_id} is {m.scale:g}")
    return tuple(
        PoseMatch(
            body_id=m.body_id,
            bank_id=m.bank_id,
            scale=m.scale,
            candidates=tuple(_msg_to_candidate(c) for c in m.candidates),
        )
        for m in msg.matches
    )


def _msg_to_candidate(msg: CandidateMsg) -> Candidate:
    t, q = msg.transform.translation, msg.transform.rotation
    turn = _sane("the turn of a match", [q.x, q.y, q.z, q.w], 2.0)
    if not 0.5 < float(turn @ turn) < 2.0:
        raise InputError(f"the turn of a match is no quaternion: its length is {np.linalg.norm(turn):g}")
    return Candidate(
        exemplar=msg.exemplar,
        view=msg.view,
        quat_xyzw=turn,
        translation=_sane("the place of a match", [t.x, t.y, t.z]),
        distance=msg.distance,
        score=msg.score,
    )


def skeleton_to_msg(skeleton: Skeleton) -> SkeletonMsg:
    """Message of a skeleton; without joints where it is lost."""
    rows = zip(
        JOINTS,
        skeleton.positions.tolist(),
        skeleton.quats_xyzw.tolist(),
        skeleton.joint_confidence.tolist(),
        skeleton.joint_states.tolist(),
        strict=False,
    )
    return SkeletonMsg(
        header=make_header(skeleton.stamp_ns, skeleton.frame_id),
        body_id=skeleton.body_id,
        source=int(skeleton.source),
        confidence=float(skeleton.confidence),
        residual=float(skeleton.residual),
        scale=float(skeleton.scale),
        joints=[
            JointMsg(
                name=name,
                position=Point(x=p[0], y=p[1], z=p[2]),
                orientation=_quaternion(q),
                confidence=confidence,
                state=state,
            )
            for name, p, q, confidence, state in rows
        ],
        build=skeleton.build.tolist(),
    )


def msg_to_skeleton(msg: SkeletonMsg) -> Skeleton:
    """Skeleton of a message, equal to the one that was sent.

    Raises
    ------
    InputError
        If there are joints, but not the 19 of `depth_pose.core.skeleton.JOINTS`, or a number is none that a
        skeleton can have.
    """
    count = len(msg.joints)
    names = [joint.name for joint in msg.joints]
    if count and sorted(names) != sorted(JOINTS):
        odd = sorted(set(names) ^ set(JOINTS))
        raise InputError(
            f"the skeleton has {count} joints; missing or unknown: {', '.join(odd) or 'doubles'}"
        )
    joints = sorted(msg.joints, key=lambda joint: JOINT_INDEX[joint.name])
    odd_state = [joint.state for joint in joints if joint.state not in _STATES]
    if odd_state:
        raise InputError(
            f"a joint of {msg.body_id} has the state {odd_state[0]}; it is one of 0 to {max(_STATES)}"
        )
    if len(msg.build) not in (0, BUILD_SIZE):
        raise InputError(
            f"the build of {msg.body_id} has {len(msg.build)} numbers; it is none, or {BUILD_SIZE}"
        )
    return Skeleton(
        stamp_ns=stamp_to_ns(msg.header.stamp),
        frame_id=msg.header.frame_id,
        body_id=msg.body_id,
        source=_source_of(msg.source),
        confidence=msg.confidence,
        residual=msg.residual,
        scale=float(_sane(f"the scale of {msg.body_id}", msg.scale, 100.0)),
        positions=_sane(
            f"a joint of {msg.body_id}", [(j.position.x, j.position.y, j.position.z) for j in joints]
        ).reshape(count, 3),
        quats_xyzw=_sane(
            f"the turn of a joint of {msg.body_id}",
            [(j.orientation.x, j.orientation.y, j.orientation.z, j.orientation.w) for j in joints],
        ).reshape(count, 4),
        joint_confidence=np.array([j.confidence for j in joints], np.float32),
        joint_states=np.array([j.state for j in joints], np.uint8),
        build=_sane(f"the build of {msg.body_id}", msg.build, 100.0).astype(np.float32),
    )


def skeletons_to_msg(skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> SkeletonArray:
    """Message of everybody in a frame."""
    return SkeletonArray(
        header=make_header(stamp_ns, frame_id), skeletons=[skeleton_to_msg(s) for s in skeletons]
    )


def fitted_to_msg(fitted: Sequence[Fitted], people: People) -> FittedArray:
    """Message of the bodies fitted to a frame's people."""
    return FittedArray(
        header=make_header(people.stamp_ns, people.frame_id),
        skeletons=[skeleton_to_msg(f.skeleton) for f in fitted],
        scores=[float(f.score) for f in fitted],
    )


def msg_to_fitted(msg: FittedArray) -> tuple[Fitted, ...]:
    """Give the fitted bodies of a message, equal to those that were sent.

    Raises
    ------
    InputError
        If there are not as many scores as skeletons, or a skeleton is damaged.
    """
    if len(msg.scores) != len(msg.skeletons):
        raise InputError(f"there are {len(msg.scores)} scores of {len(msg.skeletons)} skeletons")
    check_people("skeletons", [s.body_id for s in msg.skeletons])
    return tuple(
        Fitted(msg_to_skeleton(s), score) for s, score in zip(msg.skeletons, msg.scores, strict=True)
    )


def _source_of(number: int) -> Source:
    if number not in tuple(Source):
        raise InputError(f"the skeleton's source is {number}; it is one of 0 to {max(Source)}")
    return Source(number)


def _quaternion(xyzw: list[float]) -> Quaternion:
    x, y, z, w = xyzw
    return Quaternion(x=x, y=y, z=z, w=w)
