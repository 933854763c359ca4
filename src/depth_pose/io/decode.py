"""Depth images: from message fields to metres along the optical axis.

The functions take plain fields, not messages, so that the nodes and the readers of recordings share them.
Invalid input raises `InputError` with the field and its value.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.image_size import check_size
from depth_pose.io.depth_unit import in_metres, unit_of

_DEPTH_TYPES: dict[str, str] = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}

WRONG_ORDER = "the images' is_bigendian is wrong: their bytes are taken in the other order"
"""Warning of images with the other byte order than they say."""

_JUDGED_ROWS, _FEWEST_STEPS = 8, 100
"""Number of rows that tell the byte order, and the minimum number of steps in them; set by hand."""

_ROUGHER = 16.0
"""Integers of the wrong byte order have steps larger by this; a step of 1 becomes one of 256. Set by hand."""

_FEW, _MANY = 0.2, 0.8
"""Shares of floats that may be distances, with the wrong and with the right byte order; set by hand."""


def check_bytes(what: str, size: int, height: int, step: int, least_step: int, step_name: str) -> None:
    """Refuse data whose size and rows disagree."""
    if step < least_step:
        raise InputError(f"{what}: {step_name} is {step} bytes; a row needs at least {least_step}")
    if size != height * step:
        raise InputError(
            f"{what}: data has {size} bytes; {step_name} {step} x height {height} needs {height * step}"
        )


def is_order_wrong(
    data: bytes | bytearray | memoryview | NDArray[np.uint8],
    height: int,
    width: int,
    step: int,
    encoding: str,
    is_bigendian: bool | int = False,
) -> bool:
    """Check whether the pixels of a depth image have the other byte order than its message says.

    Then integers jump between neighbours by hundreds, and floats are no distances.

    Parameters
    ----------
    data, height, width, step, encoding, is_bigendian
        As for `decode_depth`; an image that it refuses is not judged.
    """
    if encoding not in _DEPTH_TYPES or min(height, width) < 2:
        return False
    kind = np.dtype(("<", ">")[bool(is_bigendian)] + _DEPTH_TYPES[encoding])
    raw = np.frombuffer(data, np.uint8)
    if step < width * kind.itemsize or raw.nbytes != height * step:
        return False
    every = max(1, height // _JUDGED_ROWS)
    pixels = np.ndarray((height, width), kind, buffer=raw, strides=(step, kind.itemsize))[::every].copy()
    other = pixels.view(kind.newbyteorder())
    if kind.kind == "f":
        said, swapped = (_share_of_distances(p) for p in (pixels, other))
        return said < _FEW < _MANY < swapped
    said, swapped = (_step_between(p) for p in (pixels, other))
    return said > _ROUGHER * swapped > 0.0


def _share_of_distances(metres: NDArray[np.generic]) -> float:
    """Return which share of the floats that are numbers and not zero may be distances in metres."""
    values = metres[np.isfinite(metres) & (metres != 0)]
    size = np.abs(values)
    return float(((size > 0.01) & (size < 1e5)).mean()) if values.size else 0.0


def _step_between(pixels: NDArray[np.generic]) -> float:
    """Return the median step between neighbours that differ; 0 where there are few."""
    left, right = pixels[:, :-1].astype(np.int32), pixels[:, 1:].astype(np.int32)
    steps = np.abs(right - left)[(left > 0) & (right > 0) & (left != right)]
    return float(np.median(steps)) if steps.size >= _FEWEST_STEPS else 0.0


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
    depth = in_metres(pixels, unit_m or unit_of(encoding))
    if kind.kind == "u":
        return depth
    depth[~(np.isfinite(depth) & (depth > 0))] = 0.0
    return depth
