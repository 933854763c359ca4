"""Depth images in the ``compressedDepth`` transport of ``image_transport``.

A ``sensor_msgs/CompressedImage`` with the format ``ENCODING; compressedDepth[ png| rvl]``. The data begin
with twelve bytes, a number and the two parameters A, B of the quantisation. Then follows a PNG of one 16-bit
channel, or the width, the height and RVL. For ``16UC1`` the pixels are those of the image; for ``32FC1`` they
encode ``A / (pixel - B)`` metres.

A PNG of one 16-bit channel is depth, too, without the twelve bytes or in the ``compressed`` transport.
"""

from __future__ import annotations

import io
import struct

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.image_size import check_size
from depth_pose.io import _rvl_kernels as kernels

TOPIC_ENDING = "/compressedDepth"
"""Suffix of topics with this transport."""

_HEADER = struct.Struct("<iff")
_PNG = b"\x89PNG\r\n\x1a\n"
_ONE_CHANNEL_OF_16 = b"\x10\x00"
"""Bit depth and colour type in a PNG's header."""


def decode_compressed_depth(
    format: str, data: bytes | memoryview | NDArray[np.uint8], unit_m: float | None = None
) -> NDArray[np.float32]:
    """Read a compressed depth image.

    Parameters
    ----------
    format : str
        The message's format, with the encoding.
    data : bytes-like
        The message's data.
    unit_m : float, optional
        Metres per unit, where it is not the encoding's.

    Returns
    -------
    (H, W) float32
        Metres; 0 without a measurement.

    Raises
    ------
    InputError
        If it is not a depth image, or damaged.
    """
    data = bytes(data)
    encoding = depth_encoding(format, data)
    if not encoding:
        raise InputError(
            f"compressed image: format is {format!r}; a depth image has '16UC1; compressedDepth' or "
            "'32FC1; compressedDepth': subscribe to the topic that ends in /compressedDepth"
        )
    if data.startswith(_PNG):
        if encoding == "32FC1":
            raise InputError(
                "compressed image: the PNG of 32FC1 has no header, which has its quantisation; send 16UC1"
            )
        return _to_metres(decode_png(data), unit_m)
    if len(data) < _HEADER.size + 8:
        raise InputError(f"compressed image: data has {len(data)} bytes, which is too few")
    _, a, b = _HEADER.unpack_from(data)
    body = data[_HEADER.size :]
    pixels = decode_png(body) if body.startswith(_PNG) else _decode_rvl(body)
    if encoding != "32FC1":
        return _to_metres(pixels, unit_m)
    coded = pixels.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.float32(a) / (coded - np.float32(b)) * np.float32(unit_m or 1.0)
    return np.where((pixels > 0) & np.isfinite(depth) & (depth > 0), depth, np.float32(0.0))


def depth_encoding(format: str, data: bytes) -> str:
    """Return the encoding of a compressed depth image, ``16UC1`` or ``32FC1``; empty if it is none.

    Parameters
    ----------
    format : str
        The message's format; some drivers leave out the encoding, or name only ``png``.
    data : bytes
        The message's data, or its first bytes.
    """
    encoding, _, transport = (part.strip() for part in format.rpartition(";"))
    transport, is_png16 = transport.lower(), data.startswith(_PNG) and data[24:26] == _ONE_CHANNEL_OF_16
    if encoding not in ("", "16UC1", "mono16", "32FC1"):
        return ""
    if "compresseddepth" in transport or (is_png16 and ("png" in transport or encoding)):
        return "32FC1" if encoding == "32FC1" else "16UC1"
    return ""


def _to_metres(pixels: NDArray[np.uint16], unit_m: float | None) -> NDArray[np.float32]:
    depth = pixels.astype(np.float32)
    return depth / np.float32(1000.0) if unit_m is None else depth * np.float32(unit_m)


def warm_up() -> None:
    """Compile the decoder of RVL."""
    kernels.decode(np.ones(1, np.uint8), np.empty(1, np.uint16))


def _decode_rvl(body: bytes) -> NDArray[np.uint16]:
    width, height = struct.unpack_from("<II", body)
    check_size("compressed image", height, width)
    words = np.frombuffer(body, "<u4", (len(body) - 8) // 4, 8)
    shifts = np.arange(28, -4, -4, dtype=np.uint32)
    nibbles = ((words[:, None] >> shifts) & 15).astype(np.uint8).ravel()
    out = np.empty(width * height, np.uint16)
    if not kernels.decode(nibbles, out):
        raise InputError(f"compressed image: the RVL data do not decode to {width} x {height} pixels")
    return out.reshape(height, width)


def decode_png(body: bytes) -> NDArray[np.uint16]:
    """Decode a PNG of one 16-bit channel (ISO/IEC 15948), (H, W).

    Raises
    ------
    InputError
        If it is not such a PNG, damaged or too large.
    """
    from PIL import Image

    try:
        with Image.open(io.BytesIO(body), formats=["PNG"]) as image:
            check_size("compressed image", image.height, image.width)
            if not image.mode.startswith("I"):
                raise InputError(f"compressed image: the PNG is not one 16-bit channel ({image.mode})")
            return np.asarray(image).astype(np.uint16)
    except InputError:
        raise
    except Exception as error:  # Pillow raises a dozen exception types
        raise InputError(f"compressed image: the PNG is damaged ({error})") from error
