"""Fields of a ``sensor_msgs/CameraInfo``, checked: the numbers of an image's pinhole camera and lens.

The functions take any object with the fields of a CameraInfo, so that nodes, readers of recordings and
`depth_pose.Camera` share them. Invalid input raises `InputError` with the field and its value.

The pinhole camera is ``u = fx x/z + cx``, ``v = fy y/z + cy`` (integer coordinates are pixel centres). The K
and P of a CameraInfo describe the full image of the sensor; binning and the region of interest (ROI) say
which of its pixels an image holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.distortion import distortion_of
from depth_pose.core.errors import InputError
from depth_pose.core.image_size import check_shape, check_size

_LEAST_FOCAL, _MOST_FOCAL = 0.05, 50.0
"""Limits of the focal lengths, as shares of the image's longer side: fields of view of 169 and 1.1
degrees."""

_MOST_ASPECT = 8.0
"""Maximum ratio of the focal lengths; images binned in one direction have 2."""

_MOST_BINNING = 64
"""Maximum binning of a CameraInfo."""


class Pinhole(NamedTuple):
    """Numbers of a pinhole camera, as the fields of `depth_pose.Camera`: size and intrinsics, pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


class LensNumbers(NamedTuple):
    """Numbers of an image's camera, and the model and the coefficients of its distortion."""

    pinhole: Pinhole
    model: str
    d: tuple[float, ...]


def read_camera_info(info: Any, height: int, width: int, rectified: bool = False) -> LensNumbers:
    """Return camera and lens of an image from its ``sensor_msgs/CameraInfo``.

    The image may be the full one, its ROI, or either of them binned: its size decides.

    Parameters
    ----------
    info : object
        With the fields of a CameraInfo.
    height, width : int
        Size of the image, pixels.
    rectified : bool
        Whether the image is rectified: without distortion, and with the camera of P if it is set.

    Raises
    ------
    InputError
        If a field is empty, zero or contradictory, or the image has another size.
    """
    k, p = np.asarray(info.k, np.float64), np.asarray(info.p, np.float64)
    d: NDArray[np.float64] = np.asarray(info.d, np.float64).ravel()
    k_of_p = p.reshape(-1, 4)[:, :3].ravel() if p.size == 12 else k
    has_p = bool(np.isfinite(k_of_p).all() and k_of_p[0] > 0.0)
    if rectified:
        k, d = (k_of_p if has_p else k), np.zeros(0)
    elif not k.any() and has_p:
        if d.any():
            raise InputError(
                "camera_info: k is zero and d is not: which camera the distortion is of is not known"
            )
        k = k_of_p
    left, top, bin_x, bin_y = _part_of(info, height, width)
    whole = max(int(info.width), left + width), max(int(info.height), top + height)
    full = check_pinhole(k, d, *whole, info.distortion_model)
    pinhole = Pinhole(
        int(width),
        int(height),
        full.fx / bin_x,
        full.fy / bin_y,
        (full.cx - left) / bin_x,
        (full.cy - top) / bin_y,
    )
    return LensNumbers(pinhole, *distortion_of(d, info.distortion_model))


def _part_of(info: Any, height: int, width: int) -> tuple[int, int, int, int]:
    """Return the first column and row of the full image's pixels that an image holds, and its binning.

    If the CameraInfo has the size of a ROI with an offset, K still describes the full image.
    """
    roi = info.roi
    binning = max(1, int(info.binning_x)), max(1, int(info.binning_y))
    if max(binning) > _MOST_BINNING:
        raise InputError(
            f"camera_info: binning is {binning[0]} x {binning[1]}; the maximum is {_MOST_BINNING}"
        )
    has_roi = bool(roi.width and roi.height)
    part = (int(roi.width), int(roi.height)) if has_roi else (int(info.width), int(info.height))
    offset = (int(roi.x_offset), int(roi.y_offset)) if has_roi else (0, 0)
    size = (int(width), int(height))
    if size == part:
        return *offset, 1, 1
    if _is_binned(size, part, binning):
        return *offset, *binning
    if size == (info.width, info.height):
        return 0, 0, 1, 1
    if _is_binned(size, (info.width, info.height), binning):
        return 0, 0, *binning
    region = f", its region of interest {part[0]} x {part[1]}" if has_roi else ""
    binned = f", its binning {binning[0]} x {binning[1]}" if max(binning) > 1 else ""
    raise InputError(
        f"image is {width} x {height}, its camera_info says {info.width} x {info.height}{region}{binned}"
    )


def _is_binned(size: tuple[int, int], full: tuple[int, int], binning: tuple[int, int]) -> bool:
    """Check that an image has a full image's size after binning, rounded up or down."""
    return max(binning) > 1 and all(
        s in (n // b, -(-n // b)) for s, n, b in zip(size, full, binning, strict=True)
    )


def check_pinhole(
    k: Sequence[float] | NDArray[np.float64],
    d: Sequence[float] | NDArray[np.float64],
    width: int,
    height: int,
    distortion_model: str = "plumb_bob",
) -> Pinhole:
    """Check the fields of a ``sensor_msgs/CameraInfo`` and return the numbers of its pinhole camera.

    The lens distortion is checked, too; `depth_pose.io.rectification` removes it.

    Parameters
    ----------
    k : (9,) float
        The matrix K, row by row.
    d : (n,) float
        Distortion coefficients; all zero, or none, for a rectified image.
    width, height : int
        Size, pixels.
    distortion_model : str
        ``plumb_bob``, ``rational_polynomial`` or ``equidistant``; used if `d` is not zero.

    Raises
    ------
    InputError
        If a field is empty, zero or contradictory.
    """
    check_size("camera_info", height, width)
    check_shape("camera_info", height, width)
    values = np.asarray(k, np.float64).ravel()
    if values.size != 9:
        raise InputError(f"camera_info: k has {values.size} numbers; it must have 9")
    if not np.isfinite(values).all():
        raise InputError(f"camera_info: k is {values.tolist()}; all must be finite")
    fx, skew, cx, _, fy, cy = values[:6]
    if fx <= 0 or fy <= 0:
        raise InputError(
            f"camera_info: the focal lengths k[0], k[4] are {fx:g}, {fy:g}; they must be above 0 "
            "(the camera is not calibrated)"
        )
    low, high = (factor * max(width, height) for factor in (_LEAST_FOCAL, _MOST_FOCAL))
    if not (low <= min(fx, fy) and max(fx, fy) <= high and max(fx, fy) <= _MOST_ASPECT * min(fx, fy)):
        raise InputError(
            f"camera_info: the focal lengths k[0], k[4] are {fx:g}, {fy:g} pixels; those of an image of "
            f"{width} x {height} lie between {low:g} and {high:g}, and differ little"
        )
    if abs(skew) > 1e-6 * fx:
        raise InputError(f"camera_info: k[1] is {skew:g}; a skewed image is not supported")
    if not (-width < cx < 2 * width and -height < cy < 2 * height):
        raise InputError(
            f"camera_info: the principal point k[2], k[5] is {cx:g}, {cy:g}; "
            f"that is far outside an image of {width} x {height}"
        )
    distortion_of(d, distortion_model)
    fx, fy, cx, cy = map(float, (fx, fy, cx, cy))
    return Pinhole(width=int(width), height=int(height), fx=fx, fy=fy, cx=cx, cy=cy)
