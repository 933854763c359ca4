"""Depth images: from message fields to metres along the optical axis.

The functions take plain fields, not messages, so that the nodes and the readers of recordings share them.
Invalid input raises `InputError` with the field and its value.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError

MAX_SIDE = 8192
"""Maximum rows or columns of an image or cloud; set by hand."""

MAX_PIXELS = 16_777_216
"""Maximum pixels of an image, or points of a cloud: 4096 x 4096; set by hand."""

_DEPTH_TYPES: dict[str, str] = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}

_MOST_ELONGATED = 16
"""Maximum ratio of an image's sides; a frame of 8192 x 2 pixels would take 20 s."""


def check_size(what: str, height: int, width: int, max_width: int = MAX_SIDE) -> None:
    """Refuse images and clouds that are empty or too large."""
    if height < 1 or width < 1:
        raise InputError(f"{what} is empty: width is {width}, height is {height}")
    if height > MAX_SIDE or width > max_width or height * width > MAX_PIXELS:
        raise InputError(
            f"{what} is too large: width is {width}, height is {height}; "
            f"the maximum is {max_width} x {MAX_SIDE} and {MAX_PIXELS} in all"
        )


def check_shape(what: str, height: int, width: int) -> None:
    """Refuse images that are too elongated for a camera."""
    if max(height, width) > _MOST_ELONGATED * min(height, width):
        raise InputError(
            f"{what}: width is {width}, height is {height}; the sides of a camera "
            f"image differ by at most a factor of {_MOST_ELONGATED}"
        )


def check_bytes(what: str, size: int, height: int, step: int, least_step: int, step_name: str) -> None:
    """Refuse data whose size and rows disagree."""
    if step < least_step:
        raise InputError(f"{what}: {step_name} is {step} bytes; a row needs at least {least_step}")
    if size != height * step:
        raise InputError(
            f"{what}: data has {size} bytes; {step_name} {step} x height {height} needs {height * step}"
        )


def decode_depth(
    data: bytes | bytearray | memoryview | NDArray[np.uint8],
    height: int,
    width: int,
    step: int,
    encoding: str,
    is_bigendian: bool | int = False,
    unit_m: float | None = None,
) -> NDArray[np.float32]:
    """Read the pixels of a ``sensor_msgs/Image`` that holds depth.

    Parameters
    ----------
    data : bytes-like
        The image's bytes, ``height * step`` of them.
    height, width : int
        Size, pixels.
    step : int
        Bytes of one row, padding included.
    encoding : str
        ``16UC1`` or ``mono16`` (millimetres), or ``32FC1`` (metres).
    is_bigendian : bool or int
        Byte order of the pixels.
    unit_m : float, optional
        Metres per unit, where it is not the encoding's.

    Returns
    -------
    (H, W) float32
        Metres; 0 without a measurement (NaN, infinite or negative in the message; REP 118).

    Raises
    ------
    InputError
        If the encoding is not of depth, or size, step and bytes disagree.
    """
    if encoding not in _DEPTH_TYPES:
        raise InputError(
            f"image: encoding is {encoding!r}; a depth image has one of {', '.join(_DEPTH_TYPES)}"
        )
    check_size("image", height, width)
    kind = np.dtype(("<", ">")[bool(is_bigendian)] + _DEPTH_TYPES[encoding])
    raw = np.frombuffer(data, np.uint8)
    check_bytes("image", raw.nbytes, height, step, width * kind.itemsize, "step")
    pixels: NDArray[np.generic] = np.ndarray((height, width), kind, buffer=raw, strides=(step, kind.itemsize))
    if kind.kind == "u" and unit_m is None:
        metres: NDArray[np.float32] = pixels.astype(np.float32) / np.float32(1000.0)
        return metres
    depth: NDArray[np.float32] = pixels.astype(np.float32) * np.float32(unit_m or 1.0)
    depth[~(np.isfinite(depth) & (depth > 0))] = 0.0
    return depth
