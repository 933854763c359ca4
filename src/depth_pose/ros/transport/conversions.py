"""Between ROS messages and the core's types; nothing is computed here but layout.

What the nodes hand to each other comes back bit for bit: clouds stay float32, transforms and
joint positions float64. The few float32 fields of ``depth_pose_msgs/Skeleton`` (confidence,
residual, scale and the joints' confidence) hold values that the core has already rounded.
"""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from depth_pose_msgs.msg import Candidate as CandidateMsg
from depth_pose_msgs.msg import Joint as JointMsg
from depth_pose_msgs.msg import PoseMatch as PoseMatchMsg
from depth_pose_msgs.msg import Skeleton as SkeletonMsg
from geometry_msgs.msg import Point, Quaternion, Transform, Vector3
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2, PointField
from std_msgs.msg import Header

from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, Source
from depth_pose.core.types import Candidate, DepthFrame, PersonCloud, PoseMatch, Skeleton
from depth_pose.io.compressed import decode_compressed_depth
from depth_pose.io.decode import (
    camera_from_info,
    decode_depth,
    decode_points,
    frame_from_cloud,
    rectify_depth,
)

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


def stamp_to_ns(stamp: Time) -> int:
    """Nanoseconds of a message's stamp."""
    return int(stamp.sec) * _NS_PER_S + int(stamp.nanosec)


def ns_to_stamp(stamp_ns: int) -> Time:
    """Stamp of a message from nanoseconds."""
    return Time(sec=stamp_ns // _NS_PER_S, nanosec=stamp_ns % _NS_PER_S)


def make_header(stamp_ns: int, frame_id: str) -> Header:
    """Header with the given stamp and frame."""
    return Header(stamp=ns_to_stamp(stamp_ns), frame_id=frame_id)


# --- the person's points -------------------------------------------------------------------


def cloud_to_msg(cloud: PersonCloud) -> PointCloud2:
    """Organised ``PointCloud2`` of 16 bytes a point (x, y, z float32, label uint8).

    The data go in as ``bytes``: assigning a numpy array to the field costs 50 times as much.
    """
    height, width = cloud.labels.shape
    packed = np.zeros((height, width, 4), "<f4")
    packed[..., :3] = cloud.points
    packed.view(np.uint8)[..., 12] = cloud.labels
    return PointCloud2(
        header=make_header(cloud.stamp_ns, cloud.frame_id),
        height=height,
        width=width,
        fields=_FIELDS,
        is_bigendian=False,
        point_step=POINT_DTYPE.itemsize,
        row_step=POINT_DTYPE.itemsize * width,
        data=packed.tobytes(),
        is_dense=False,
    )


def msg_to_cloud(msg: PointCloud2) -> PersonCloud:
    """Person cloud of a message that `cloud_to_msg` made.

    Raises
    ------
    InputError
        If the layout is another one, or the data are shorter than they should be.
    """
    layout = [(f.name, f.offset, f.datatype) for f in msg.fields]
    if layout != [(f.name, f.offset, f.datatype) for f in _FIELDS] or msg.point_step != 16:
        found = ", ".join(f"{name} at {offset}" for name, offset, _ in layout)
        raise InputError(
            f"the cloud's fields are {found or 'none'} in {msg.point_step} bytes; a person cloud has "
            "x, y, z (float32) and label (uint8) in 16: subscribe to the denoise node's points"
        )
    size = msg.height * msg.width * 16
    if msg.is_bigendian or len(msg.data) != size or msg.row_step != 16 * msg.width:
        raise InputError(
            f"the person cloud has {len(msg.data)} bytes of data, not the {size} little-endian ones "
            f"of its {msg.width} x {msg.height} points"
        )
    packed = np.frombuffer(msg.data, np.uint8).reshape(msg.height, msg.width, 16)
    points = np.ascontiguousarray(packed[..., :12]).view("<f4")
    return PersonCloud(
        stamp_ns=stamp_to_ns(msg.header.stamp),
        frame_id=msg.header.frame_id,
        points=points.astype(np.float32, copy=False),
        labels=np.ascontiguousarray(packed[..., 12]),
    )


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


def match_to_msg(match: PoseMatch) -> PoseMatchMsg:
    """Message of a match."""
    return PoseMatchMsg(
        header=make_header(match.stamp_ns, match.frame_id),
        bank_id=match.bank_id,
        scale=float(match.scale),
        candidates=[_candidate_to_msg(c) for c in match.candidates],
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


def msg_to_match(msg: PoseMatchMsg) -> PoseMatch:
    """Match of a message, equal to the one that was sent."""
    return PoseMatch(
        stamp_ns=stamp_to_ns(msg.header.stamp),
        frame_id=msg.header.frame_id,
        bank_id=msg.bank_id,
        scale=msg.scale,
        candidates=tuple(_msg_to_candidate(c) for c in msg.candidates),
    )


def _msg_to_candidate(msg: CandidateMsg) -> Candidate:
    t, q = msg.transform.translation, msg.transform.rotation
    return Candidate(
        exemplar=msg.exemplar,
        view=msg.view,
        quat_xyzw=np.array([q.x, q.y, q.z, q.w]),
        translation=np.array([t.x, t.y, t.z]),
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
    )


def msg_to_skeleton(msg: SkeletonMsg) -> Skeleton:
    """Skeleton of a message, equal to the one that was sent.

    Raises
    ------
    InputError
        If there are joints, but not the 19 of `depth_pose.core.skeleton.JOINTS`.
    """
    count = len(msg.joints)
    names = [joint.name for joint in msg.joints]
    if count and sorted(names) != sorted(JOINTS):
        odd = sorted(set(names) ^ set(JOINTS))
        raise InputError(
            f"the skeleton has {count} joints; missing or unknown: {', '.join(odd) or 'doubles'}"
        )
    joints = sorted(msg.joints, key=lambda joint: JOINT_INDEX[joint.name])
    return Skeleton(
        stamp_ns=stamp_to_ns(msg.header.stamp),
        frame_id=msg.header.frame_id,
        body_id=msg.body_id,
        source=Source(msg.source),
        confidence=msg.confidence,
        residual=msg.residual,
        scale=msg.scale,
        positions=np.array([(j.position.x, j.position.y, j.position.z) for j in joints]).reshape(count, 3),
        quats_xyzw=np.array(
            [(j.orientation.x, j.orientation.y, j.orientation.z, j.orientation.w) for j in joints]
        ).reshape(count, 4),
        joint_confidence=np.array([j.confidence for j in joints], np.float32),
        joint_states=np.array([j.state for j in joints], np.uint8),
    )


def _quaternion(xyzw: list[float]) -> Quaternion:
    x, y, z, w = xyzw
    return Quaternion(x=x, y=y, z=z, w=w)
