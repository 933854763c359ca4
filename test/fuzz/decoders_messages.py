"""Decoders of messages: what a recording holds and what comes from the network."""

from __future__ import annotations

import io
import struct

import numpy as np
from harness import Decoder
from PIL import Image

from depth_pose.core.camera import Camera
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import Source
from depth_pose.io import schemas
from depth_pose.io.compressed import decode_compressed_depth
from depth_pose.io.mcap_read import frame_of_cloud, frame_of_image
from depth_pose.io.messages import (
    make,
    read_people,
    read_skeleton,
    write_camera_info,
    write_image,
    write_message,
)
from depth_pose.io.skeleton_cdr import write_people, write_skeleton

CAMERA = Camera(32, 24, 30.0, 30.0, 15.5, 11.5)


def pixels() -> np.ndarray:
    """Depth of a slope, millimetres, with holes."""
    mm = np.add.outer(np.arange(24) * 40, np.arange(32) * 10).astype(np.uint16) + 1000
    mm[::5, ::3] = 0
    return mm


def images() -> list[bytes]:
    """Images in millimetres and in metres."""
    mm = pixels()
    plain = write_image(7, "optical", mm)
    return [
        plain,
        write_image(8, "optical", (mm / 1e3).astype(np.float32)),
    ]


def infos() -> list[bytes]:
    """Calibrations, with distortion too."""
    k = np.ravel(CAMERA.matrix())
    out = [write_camera_info(7, "optical", CAMERA)]
    for model, d in (("plumb_bob", [0.1, -0.2, 1e-3, 1e-3, 0.0]), ("equidistant", [0.1, 0.01, 0.0, 0.0])):
        out.append(
            write_message(
                schemas.CAMERA_INFO,
                7,
                "optical",
                height=24,
                width=32,
                distortion_model=model,
                d=np.array(d),
                k=k,
                r=np.eye(3).ravel(),
                p=np.zeros(12),
                binning_x=0,
                binning_y=0,
                roi=make(schemas.REGION, 0, 0, 0, 0, False),
            )
        )
    return out


def compressed() -> list[bytes]:
    """The data of compressedDepth images, PNG and RVL."""
    mm = pixels()
    png = io.BytesIO()
    Image.fromarray(mm).save(png, "PNG")
    header = struct.pack("<iff", 0, 0.0, 0.0)
    rvl = header + struct.pack("<II", 2, 1) + _rvl([1000, 1001])
    return [header + png.getvalue(), rvl]


def _rvl(values: list[int]) -> bytes:
    """Code pixels that are all above zero."""
    numbers, before = [0, len(values)], 0
    for value in values:
        difference, before = value - before, value
        numbers.append((difference << 1) ^ (difference >> 31))
    nibbles: list[int] = []
    for number in numbers:
        while True:
            number, three = number >> 3, number & 7
            nibbles.append(three | (8 if number else 0))
            if not number:
                break
    nibbles += [0] * (-len(nibbles) % 8)
    words = [nibbles[i : i + 8] for i in range(0, len(nibbles), 8)]
    return b"".join(struct.pack("<I", sum(n << (28 - 4 * i) for i, n in enumerate(word))) for word in words)


def clouds() -> list[bytes]:
    """An organised cloud and one that is not."""
    v, u = np.mgrid[:24, :32].astype(np.float32)
    points = np.stack([(u - 15.5) / 30 * 2, (v - 11.5) / 30 * 2, np.full_like(u, 2)], axis=-1)
    fields = [make("sensor_msgs/msg/PointField", n, 4 * i, 7, 1) for i, n in enumerate("xyz")]
    return [
        write_message(
            schemas.POINT_CLOUD,
            7,
            "optical",
            height=height,
            width=width,
            fields=fields,
            is_bigendian=False,
            point_step=12,
            row_step=12 * width,
            data=points.reshape(-1).view(np.uint8),
            is_dense=True,
        )
        for height, width in ((24, 32), (1, 24 * 32))
    ]


def skeleton(seed: int = 0) -> Skeleton:
    """Somebody."""
    rng = np.random.default_rng(seed)
    return Skeleton(
        7,
        "optical",
        "b1",
        Source.REFINED,
        0.7,
        0.01,
        1.05,
        rng.normal(size=(19, 3)),
        rng.normal(size=(19, 4)),
        rng.random(19).astype(np.float32),
        rng.integers(0, 4, 19).astype(np.uint8),
        rng.normal(0.0, 0.05, 13).astype(np.float32),
    )


def _read_image(data: bytes) -> object:
    return frame_of_image(data, schemas.IMAGE, infos()[0])


def _read_info(data: bytes) -> object:
    return frame_of_image(images()[0], schemas.IMAGE, data)


DECODERS = (
    Decoder("image", images, _read_image),
    Decoder("camera_info", infos, _read_info),
    Decoder(
        "compressed_depth", compressed, lambda data: decode_compressed_depth("16UC1; compressedDepth", data)
    ),
    Decoder("point_cloud", clouds, frame_of_cloud),
    Decoder("skeleton", lambda: [write_skeleton(skeleton())], read_skeleton),
    Decoder("skeletons", lambda: [write_people([skeleton(), skeleton(1)], 7, "optical")], read_people),
)
