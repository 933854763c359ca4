"""Camera calibrations: pinhole cameras from the fields of a CameraInfo, and rectification of images.

The functions take plain fields, not messages, so that the nodes and the readers of recordings share them.
Invalid input raises `InputError` with the field and its value.

The pinhole camera is ``u = fx x/z + cx``, ``v = fy y/z + cy`` (integer coordinates are pixel centres).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.io.decode import MAX_PIXELS, check_shape, check_size

_DISTORTION_LENGTHS = {"plumb_bob": (4, 5), "rational_polynomial": (8,), "equidistant": (4,)}
"""Allowed numbers of coefficients of each model of ``sensor_msgs/distortion_models``."""

_LEAST_FOCAL, _MOST_FOCAL = 0.05, 50.0
"""Limits of the focal lengths, as shares of the image's longer side: fields of view of 169 and 1.1
degrees; set by hand."""

_MOST_ASPECT = 8.0
"""Maximum ratio of the focal lengths; images binned in one direction have 2; set by hand."""

_BAND = 64
"""Number of rows rectified at a time; set by hand."""

_KEPT_PIXELS = MAX_PIXELS
"""Maximum pixels of cached rectifications, 9 bytes each: 54 cameras of 640 x 480; set by hand."""


def is_rectified(topic: str) -> bool:
    """Check that a topic's images are rectified, by its name: ``image_rect``, ``image_depth_rect``.

    By the convention of ``image_proc`` their CameraInfo is that of the raw image: K and D describe the lens,
    and P the rectified image.
    """
    return "rect" in topic.removesuffix("/compressedDepth").rpartition("/")[2].split("_")


def lens_of(
    k: NDArray[np.float64], d: NDArray[np.float64], p: NDArray[np.float64], rectified: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return K (9,) and D (n,) of an image from the k, d, p of its ``sensor_msgs/CameraInfo``.

    For a rectified image (`is_rectified`) D is empty, and K is taken from P if P is set.
    """
    if not rectified:
        return k, d
    k_of_p = np.asarray(p, np.float64).reshape(-1, 4)[:, :3].ravel()
    return (k_of_p if k_of_p.size == 9 and k_of_p[0] > 0.0 else k), np.zeros(0)


def camera_from_info(
    k: Sequence[float] | NDArray[np.float64],
    d: Sequence[float] | NDArray[np.float64],
    width: int,
    height: int,
    distortion_model: str = "plumb_bob",
) -> Camera:
    """Check the fields of a ``sensor_msgs/CameraInfo`` and return its pinhole camera.

    The lens distortion is not part of a `Camera`: `rectify_depth` removes it from the image.

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
    _distortion(d, distortion_model)
    fx, fy, cx, cy = map(float, (fx, fy, cx, cy))
    return Camera(width=int(width), height=int(height), fx=fx, fy=fy, cx=cx, cy=cy)


def _distortion(d: Sequence[float] | NDArray[np.float64], model: str) -> tuple[float, ...]:
    """Check and return the coefficients; none without distortion."""
    coefficients = tuple(float(x) for x in d)
    if not any(coefficients):
        return ()
    if not np.isfinite(coefficients).all():
        raise InputError(f"camera_info: d is {list(coefficients)}; all must be finite")
    if model not in _DISTORTION_LENGTHS:
        raise InputError(
            f"camera_info: distortion_model is {model!r}; it must be one of "
            f"{', '.join(_DISTORTION_LENGTHS)}, or give a rectified image and its camera_info"
        )
    if len(coefficients) not in _DISTORTION_LENGTHS[model]:
        raise InputError(
            f"camera_info: d has {len(coefficients)} numbers; "
            f"{model} has {' or '.join(map(str, _DISTORTION_LENGTHS[model]))}"
        )
    return coefficients


def rectify_depth(
    depth: NDArray[np.float32],
    camera: Camera,
    d: Sequence[float] | NDArray[np.float64],
    distortion_model: str = "plumb_bob",
) -> NDArray[np.float32]:
    """Remove the lens distortion from a depth image.

    Every pixel of the ideal camera takes the *nearest* pixel of the image, because depth cannot be
    interpolated between two surfaces.

    Parameters
    ----------
    depth : (H, W) float32
        Metres.
    camera : Camera
        From `camera_from_info`; also the camera of the result.
    d : (n,) float
        Distortion coefficients.
    distortion_model : str
        ``plumb_bob``, ``rational_polynomial`` or ``equidistant``.

    Returns
    -------
    (H, W) float32
        Metres; 0 without a measurement. The input itself if there is no distortion.
    """
    if depth.shape != (camera.height, camera.width):
        raise InputError(
            f"image is {depth.shape[1]} x {depth.shape[0]}, "
            f"its camera_info says {camera.width} x {camera.height}"
        )
    coefficients = _distortion(d, distortion_model)
    if not coefficients:
        return depth
    source, outside = _rectification(camera, coefficients, distortion_model)
    rectified: NDArray[np.float32] = depth.ravel()[source]
    rectified[outside] = 0.0
    return rectified


def _rectification(
    camera: Camera, d: tuple[float, ...], model: str
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the index of each ideal pixel's distorted pixel, and whether there is none, (H, W)."""
    key = (camera, d, model)
    if key not in _rectifications:
        made = _make_rectification(camera, d, model)
        size = made[0].size
        while _rectifications and size + sum(s.size for s, _ in _rectifications.values()) > _KEPT_PIXELS:
            _rectifications.pop(next(iter(_rectifications)), None)
        _rectifications[key] = made
    return _rectifications[key]


_rectifications: dict[tuple[Camera, tuple[float, ...], str], tuple[NDArray[np.int64], NDArray[np.bool_]]] = {}
"""Cache of the last cameras, up to `_KEPT_PIXELS`."""


def _make_rectification(
    camera: Camera, d: tuple[float, ...], model: str
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Compute a rectification in bands of rows, to limit the memory of float64 intermediates."""
    source = np.zeros((camera.height, camera.width), np.int64)
    outside = np.zeros((camera.height, camera.width), np.bool_)
    u = np.arange(camera.width, dtype=np.float64)
    for first in range(0, camera.height, _BAND):
        band = slice(first, min(first + _BAND, camera.height))
        v = np.arange(band.start, band.stop, dtype=np.float64)[:, None]
        with np.errstate(all="ignore"):  # a ray outside the lens model is marked as outside the image
            rays = np.broadcast_arrays((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
            a, b = distort(rays[0], rays[1], d, model)
            column = np.rint(camera.fx * a + camera.cx)
            row = np.rint(camera.fy * b + camera.cy)
        inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        source[band] = np.where(inside, row * camera.width + column, 0)
        outside[band] = ~inside
    return source, outside


def distort(
    a: NDArray[np.float64], b: NDArray[np.float64], d: Sequence[float], model: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distort the ray (a, b, 1) by a model of ``sensor_msgs/distortion_models``.

    Parameters
    ----------
    a, b : (...) float64
        Ideal ``x/z`` and ``y/z``.
    d : sequence of float
        ``plumb_bob``: k1, k2, p1, p2[, k3]; ``rational_polynomial``: those and k4, k5, k6;
        ``equidistant``: k1, k2, k3, k4.
    model : str
        The model's name.

    Returns
    -------
    (...), (...) float64
        Distorted ``x/z`` and ``y/z``.
    """
    r2 = a * a + b * b
    if model == "equidistant":
        r = np.sqrt(r2)
        theta = np.arctan(r)
        t2 = theta * theta
        radial = theta * (1 + t2 * (d[0] + t2 * (d[1] + t2 * (d[2] + t2 * d[3]))))
        factor = np.where(r > 1e-9, radial / np.maximum(r, 1e-9), 1.0)
        return a * factor, b * factor
    k1, k2, p1, p2 = d[:4]
    k3 = d[4] if len(d) > 4 else 0.0
    factor = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    if model == "rational_polynomial":
        factor = factor / (1 + r2 * (d[5] + r2 * (d[6] + r2 * d[7])))
    return (
        a * factor + 2 * p1 * a * b + p2 * (r2 + 2 * a * a),
        b * factor + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b,
    )
