"""The messages that recordings are read from and written with, field by field, as CDR."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointState, Source
from depth_pose.core.types import Skeleton
from depth_pose.io._cdr import CdrReader, CdrWriter

_MOST_ELEMENTS = 1_000_000


@dataclass(frozen=True)
class ImageMessage:
    """``sensor_msgs/msg/Image``."""

    stamp_ns: int
    frame_id: str
    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: memoryview


@dataclass(frozen=True)
class CompressedMessage:
    """``sensor_msgs/msg/CompressedImage``."""

    stamp_ns: int
    frame_id: str
    format: str
    data: memoryview


@dataclass(frozen=True)
class CameraInfoMessage:
    """``sensor_msgs/msg/CameraInfo``, as far as it is used."""

    stamp_ns: int
    frame_id: str
    height: int
    width: int
    distortion_model: str
    d: NDArray[np.float64]
    k: NDArray[np.float64]


@dataclass(frozen=True)
class CloudMessage:
    """``sensor_msgs/msg/PointCloud2``."""

    stamp_ns: int
    frame_id: str
    height: int
    width: int
    fields: dict[str, tuple[int, int]]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: memoryview


def _count(cdr: CdrReader, what: str) -> int:
    count = cdr.number("I")
    if count > _MOST_ELEMENTS:
        raise InputError(f"{what} has {count} elements; the message is damaged")
    return count


def read_image(data: bytes) -> ImageMessage:
    """Decode an Image."""
    cdr = CdrReader(data, "Image")
    stamp_ns, frame_id = cdr.header()
    height, width = cdr.number("I"), cdr.number("I")
    encoding, is_bigendian, step = cdr.text(), cdr.number("B"), cdr.number("I")
    return ImageMessage(stamp_ns, frame_id, height, width, encoding, is_bigendian, step, cdr.octets())


def read_compressed(data: bytes) -> CompressedMessage:
    """Decode a CompressedImage."""
    cdr = CdrReader(data, "CompressedImage")
    stamp_ns, frame_id = cdr.header()
    return CompressedMessage(stamp_ns, frame_id, cdr.text(), cdr.octets())


def read_camera_info(data: bytes) -> CameraInfoMessage:
    """Decode a CameraInfo."""
    cdr = CdrReader(data, "CameraInfo")
    stamp_ns, frame_id = cdr.header()
    height, width, model = cdr.number("I"), cdr.number("I"), cdr.text()
    d = cdr.reals(_count(cdr, "CameraInfo.d"))
    return CameraInfoMessage(stamp_ns, frame_id, height, width, model, d, cdr.reals(9))


def read_cloud(data: bytes) -> CloudMessage:
    """Decode a PointCloud2."""
    cdr = CdrReader(data, "PointCloud2")
    stamp_ns, frame_id = cdr.header()
    height, width = cdr.number("I"), cdr.number("I")
    fields = {}
    for _ in range(_count(cdr, "PointCloud2.fields")):
        name, offset, datatype, _count_of = cdr.text(), cdr.number("I"), cdr.number("B"), cdr.number("I")
        fields[name] = (offset, datatype)
    big, point_step, row_step = bool(cdr.number("B")), cdr.number("I"), cdr.number("I")
    return CloudMessage(stamp_ns, frame_id, height, width, fields, big, point_step, row_step, cdr.octets())


def read_skeleton(data: bytes) -> Skeleton:
    """Decode a Skeleton; its joints are put into the order of `JOINTS`."""
    cdr = CdrReader(data, "Skeleton")
    stamp_ns, frame_id = cdr.header()
    body_id, source = cdr.text(), cdr.number("B")
    confidence, residual, scale = cdr.real("f"), cdr.real("f"), cdr.real("f")
    if source not in tuple(Source):
        raise InputError(f"Skeleton: source is {source}; it is one of 0 to {max(Source)}")
    count = _count(cdr, "Skeleton.joints")
    size = len(JOINTS) if count else 0
    positions = np.full((size, 3), np.nan)
    quats = np.full((size, 4), np.nan)
    joint_confidence = np.zeros(size, np.float32)
    states = np.full(size, JointState.LOST, np.uint8)
    for _ in range(count):
        name, numbers = cdr.text(), cdr.reals(7)
        joint = JOINT_INDEX.get(name)
        certainty, state = cdr.real("f"), cdr.number("B")
        if joint is not None:
            positions[joint], quats[joint] = numbers[:3], numbers[3:]
            joint_confidence[joint], states[joint] = certainty, state
    return Skeleton(
        stamp_ns,
        frame_id,
        body_id,
        Source(source),
        confidence,
        residual,
        scale,
        positions,
        quats,
        joint_confidence,
        states,
    )


def write_skeleton(skeleton: Skeleton) -> bytes:
    """Encode a Skeleton."""
    cdr = CdrWriter()
    cdr.header(skeleton.stamp_ns, skeleton.frame_id)
    cdr.text(skeleton.body_id)
    cdr.number("B", int(skeleton.source))
    cdr.number("f", skeleton.confidence, skeleton.residual, skeleton.scale)
    cdr.number("I", len(skeleton.positions))
    for joint in range(len(skeleton.positions)):
        cdr.text(JOINTS[joint])
        cdr.number("d", *skeleton.positions[joint], *skeleton.quats_xyzw[joint])
        cdr.number("f", skeleton.joint_confidence[joint])
        cdr.number("B", int(skeleton.joint_states[joint]))
    return cdr.bytes()


def write_image(stamp_ns: int, frame_id: str, pixels: NDArray[np.generic]) -> bytes:
    """Encode an Image: uint16 millimetres as 16UC1, float32 metres as 32FC1, uint8 as mono8."""
    encoding = {"uint8": "mono8", "uint16": "16UC1", "float32": "32FC1"}[pixels.dtype.name]
    little = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<"))
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame_id)
    cdr.number("I", *pixels.shape)
    cdr.text(encoding)
    cdr.number("B", 0)
    cdr.number("I", pixels.shape[1] * pixels.dtype.itemsize)
    cdr.octets(little.tobytes())
    return cdr.bytes()


def write_camera_info(stamp_ns: int, frame_id: str, camera: Camera) -> bytes:
    """Encode the CameraInfo of a pinhole camera without distortion."""
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame_id)
    cdr.number("I", camera.height, camera.width)
    cdr.text("plumb_bob")
    cdr.number("I", 5)
    cdr.number("d", *([0.0] * 5))
    cdr.number("d", fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    cdr.number("d", 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    cdr.number("d", fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0)
    cdr.number("I", 0, 0)  # binning
    cdr.number("I", 0, 0, 0, 0)  # region of interest: the whole image
    cdr.number("?", False)
    return cdr.bytes()
