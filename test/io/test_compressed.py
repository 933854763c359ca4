"""compressedDepth: what other programs wrote is read, and damage is told."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from PIL import Image

from depth_pose.core.errors import InputError
from depth_pose.io.compressed import decode_compressed_depth, depth_encoding
from depth_pose.io.mcap_read import DepthReader

SIZES = [(1, 1), (3, 5), (48, 64), (144, 176)]


def depth_image(height: int, width: int, seed: int = 0) -> np.ndarray:
    """Millimetres: slopes, steps, holes and full range."""
    rng = np.random.default_rng(seed)
    depth = (1500 + 3 * np.arange(width) + 7 * np.arange(height)[:, None]).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.1] = 0
    depth[: height // 3, : width // 2] = 0
    depth[height // 2 :, width // 2 :] += 2000
    depth[-1, -1] = 65535
    return depth


def encode_rvl(depth: np.ndarray) -> bytes:
    """The coder as its paper's text has it, number by number."""
    nibbles: list[int] = []

    def write(number: int) -> None:
        while True:
            number, three = number >> 3, number & 7
            nibbles.append(three | (8 if number else 0))
            if not number:
                return

    flat, at, previous = depth.ravel().tolist(), 0, 0
    while at < len(flat):
        start = at
        while at < len(flat) and flat[at] == 0:
            at += 1
        write(at - start)
        start = at
        while at < len(flat) and flat[at] != 0:
            at += 1
        write(at - start)
        for value in flat[start:at]:
            difference, previous = value - previous, value
            write((difference << 1) ^ (difference >> 63))
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{n:x}" for n in nibbles[k : k + 8]), 16) for k in range(0, len(nibbles), 8)]
    height, width = depth.shape
    return struct.pack(f"<II{len(words)}I", width, height, *words)


def encode_png(depth: np.ndarray) -> bytes:
    out = io.BytesIO()
    Image.fromarray(depth).save(out, "PNG")
    return out.getvalue()


def message(body: bytes, a: float = 0.0, b: float = 0.0) -> bytes:
    return struct.pack("<iff", 0, a, b) + body


@pytest.mark.parametrize("encode", [encode_png, encode_rvl])
@pytest.mark.parametrize("size", SIZES)
def test_both_ways_give_the_same_millimetres(encode, size) -> None:
    depth = depth_image(*size)
    got = decode_compressed_depth("16UC1; compressedDepth png", message(encode(depth)))
    assert got.dtype == np.float32
    assert_array_equal(np.round(got * 1000).astype(np.uint16), depth)
    assert_array_equal(got, depth.astype(np.float32) / np.float32(1000))


def test_rvl_of_one_line_by_hand() -> None:
    """Two zeros, then 3 and 1: counts 2 and 2, differences +3 (6) and -2 (3)."""
    body = struct.pack("<III", 4, 1, 0x22630000)
    got = decode_compressed_depth("16UC1; compressedDepth rvl", message(body))
    assert_array_equal(np.round(got * 1000), [[0, 0, 3, 1]])


@pytest.mark.parametrize("kind", ["filters", "noise"])
def test_every_png_filter(kind) -> None:
    """Images that make the encoder choose different filters row by row."""
    rng = np.random.default_rng(1)
    depth = (rng.random((60, 80)) * 65535).astype(np.uint16) if kind == "noise" else depth_image(60, 80)
    got = decode_compressed_depth("16UC1; compressedDepth", message(encode_png(depth)))
    assert_array_equal(np.round(got * 1000).astype(np.uint16), depth)


@pytest.mark.parametrize("encode", [encode_png, encode_rvl])
def test_metres_come_from_the_inverse(encode) -> None:
    """32FC1 is quantised so that the inverse of the depth is even; A and B say how."""
    a, b = 4000.0, -300.0
    metres = np.linspace(0.5, 8.0, 600).reshape(20, 30).astype(np.float32)
    coded = np.round(a / metres + b).astype(np.uint16)
    coded[3, 4] = 0
    got = decode_compressed_depth("32FC1; compressedDepth png", message(encode(coded), a, b))
    assert got[3, 4] == 0
    metres[3, 4] = 0
    np.testing.assert_allclose(got, metres, rtol=0.5 * 8.0 / a * 1.1)


@pytest.mark.parametrize(
    ("format", "data", "words"),
    [
        ("rgb8; jpeg compressed bgr8", b"x" * 40, "compressedDepth"),
        ("16UC1; compressedDepth png", b"x", "too few"),
        ("16UC1; compressedDepth rvl", message(struct.pack("<II", 100, 100)), "100 x 100"),
        ("16UC1; compressedDepth rvl", message(struct.pack("<II", 1 << 20, 9)), "too large"),
        ("16UC1; compressedDepth png", message(encode_png(depth_image(9, 9))[:-30]), "PNG"),
        ("16UC1; compressedDepth png", message(encode_png(np.zeros((9, 9), np.uint8))), "16-bit"),
    ],
)
def test_what_cannot_be_read_is_said(format, data, words) -> None:
    with pytest.raises(InputError, match=words):
        decode_compressed_depth(format, data)


def test_random_bytes_never_crash() -> None:
    rng = np.random.default_rng(4)
    for k in range(300):
        body = struct.pack("<II", 40, 30) + rng.bytes(int(rng.integers(4, 400)))
        try:
            decode_compressed_depth("16UC1; compressedDepth rvl", message(body))
        except InputError:
            continue
        assert k >= 0


def test_recordings_of_it_are_read(tmp_path) -> None:
    """An MCAP file with compressed depth, written by a plain writer, gives the same frames."""
    from mcap.writer import Writer

    from depth_pose.core.camera import Camera
    from depth_pose.core.frame import DepthFrame
    from depth_pose.io.mcap_write import DepthWriter
    from depth_pose.io.messages import write_message

    camera = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
    depth = depth_image(48, 64)
    plain, packed = tmp_path / "plain.mcap", tmp_path / "packed.mcap"
    with DepthWriter(plain, camera, "optical") as writer:
        writer.write_frame(DepthFrame(10**18, "optical", depth.astype(np.float32) / 1000, camera))
    body = np.frombuffer(message(encode_rvl(depth)), np.uint8)
    kind, coding = "sensor_msgs/msg/CompressedImage", "16UC1; compressedDepth rvl"
    image = write_message(kind, 10**18, "optical", format=coding, data=body)
    from depth_pose.io.recording import Recording

    info = Recording(plain).first("/camera/depth/camera_info")
    with packed.open("wb") as file:
        out = Writer(file)
        out.start()
        for topic, name, data in (
            ("/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", info.data),
            ("/camera/depth/image_raw/compressedDepth", kind, image),
        ):
            schema = out.register_schema(name, "ros2msg", b"")
            channel = out.register_channel(topic, "cdr", schema)
            out.add_message(channel, 10**18, data, 10**18)
        out.finish()
    (frame,) = DepthReader(packed)
    (expected,) = DepthReader(plain)
    assert frame.camera == expected.camera
    assert_array_equal(frame.depth, expected.depth)


@pytest.mark.parametrize(
    "format", ["16UC1; compressedDepth", "16UC1; png compressed ", "png", "16UC1; compressedDepth png"]
)
def test_a_png_without_the_header_or_on_compressed_is_depth(format) -> None:
    depth = depth_image(48, 64)
    assert_array_equal(np.round(decode_compressed_depth(format, encode_png(depth)) * 1000), depth)


@pytest.mark.parametrize("format", ["compressedDepth", "compressedDepth png", " ; compressedDepth rvl"])
@pytest.mark.parametrize("encode", [encode_png, encode_rvl])
def test_formats_without_the_encoding_are_millimetres(encode, format) -> None:
    depth = depth_image(48, 64)
    assert_array_equal(np.round(decode_compressed_depth(format, message(encode(depth))) * 1000), depth)


@pytest.mark.parametrize(
    "format", ["png", "16UC1; png compressed ", "rgb8; jpeg compressed bgr8", "jpeg", "8UC1; png", ""]
)
def test_colour_is_no_depth(format) -> None:
    assert not depth_encoding(format, encode_png(np.zeros((9, 9), np.uint8)))
    with pytest.raises(InputError, match="compressedDepth"):
        decode_compressed_depth(format, encode_png(np.zeros((9, 9, 3), np.uint8)))


def test_metres_without_the_header_are_refused() -> None:
    with pytest.raises(InputError, match="no header"):
        decode_compressed_depth("32FC1; compressedDepth png", encode_png(depth_image(9, 9)))


@pytest.mark.parametrize(
    ("topic", "format", "head"),
    [
        ("/camera/depth/image_raw/compressed", "16UC1; png compressed ", b""),
        ("/camera/depth/packed", "16UC1; compressedDepth png", struct.pack("<iff", 0, 0, 0)),
        ("/camera/depth/image_raw/compressedDepth", "16UC1; compressedDepth", b""),
    ],
)
def test_depth_topics_are_found_by_their_content(tmp_path, topic, format, head) -> None:
    from depth_pose.core.camera import Camera
    from depth_pose.io import schemas
    from depth_pose.io.mcap_write import RecordingWriter
    from depth_pose.io.messages import write_camera_info, write_message

    depth, camera = depth_image(48, 64), Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
    data = np.frombuffer(head + encode_png(depth), np.uint8)
    colour = np.frombuffer(encode_png(np.zeros((48, 64, 3), np.uint8)), np.uint8)
    with RecordingWriter(tmp_path / "a.mcap") as out:
        info = write_camera_info(1, "optical", camera)
        out.write_message("/camera/depth/camera_info", schemas.CAMERA_INFO, 1, info)
        for name, body, kind in (
            ("/camera/color/compressed", colour, "rgb8; png compressed bgr8"),
            (topic, data, format),
        ):
            image = write_message(schemas.COMPRESSED, 1, "optical", format=kind, data=body)
            out.write_message(name, schemas.COMPRESSED, 1, image)
    (frame,) = DepthReader(tmp_path / "a.mcap")
    assert_array_equal(np.round(frame.depth * 1000), depth)
