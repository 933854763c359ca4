"""Recordings for tests, and ways to damage them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from depth_pose.core.camera import Camera
from depth_pose.io import schemas
from depth_pose.io.messages import write_camera_info, write_image

CAMERA = Camera(64, 48, 60.0, 61.0, 31.5, 23.5)
IMAGE, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"
CHUNK = 16_384
STEP_NS = 40_000_000


def depth_mm(i: int) -> np.ndarray:
    """The pixels of an image, millimetres; nothing that packs well."""
    return np.random.default_rng(i).integers(500, 5000, (48, 64)).astype(np.uint16)


def messages(frames: int) -> list[tuple[str, str, int, bytes]]:
    """Images and calibrations: topic, type, log time, bytes."""
    found = []
    for i in range(frames):
        ns = 1_000_000_000 + i * STEP_NS
        found.append((INFO, schemas.CAMERA_INFO, ns, write_camera_info(ns, "optical", CAMERA)))
        found.append((IMAGE, schemas.IMAGE, ns, write_image(ns, "optical", depth_mm(i))))
    return found


def write(path: Path, frames: int = 40, **options: object) -> Path:
    """Write a recording of several chunks; options are those of mcap's writer."""
    options = {"chunk_size": CHUNK, "compression": CompressionType.ZSTD, **options}
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start("ros2", "test")
        numbers: dict[str, int] = {}
        for topic, kind, ns, data in messages(frames):
            if topic not in numbers:
                schema = writer.register_schema(kind, "ros2msg", schemas.schema_text(kind).encode())
                numbers[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(numbers[topic], ns, data, ns)
        writer.finish()
    return path


def record_places(path: Path) -> list[tuple[int, int, int]]:
    """Kinds, offsets and lengths of a file's records."""
    data, at, found = path.read_bytes(), 8, []
    while at < len(data) - 8:
        kind, length = struct.unpack_from("<BQ", data, at)
        found.append((kind, at, 9 + length))
        at += 9 + length
    return found


def chunk_places(path: Path) -> list[tuple[int, int]]:
    """Offsets and lengths of the chunks' records."""
    return [(at, length) for kind, at, length in record_places(path) if kind == Opcode.CHUNK]


def summary_place(path: Path) -> tuple[int, int]:
    """Where the summary begins, and where the footer does."""
    data = path.read_bytes()
    at = len(data) - 8 - 29
    return struct.unpack_from("<Q", data, at + 9)[0], at


def flip(path: Path, at: int, bit: int = 3) -> Path:
    """Flip a bit of a file."""
    data = bytearray(path.read_bytes())
    data[at] ^= 1 << bit
    path.write_bytes(data)
    return path
