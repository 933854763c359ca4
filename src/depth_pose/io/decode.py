"""Depth images, camera calibrations and point clouds: from message fields to metres.

The functions take plain fields, not messages, so that the nodes and the readers of
recordings share them. What cannot be used raises `InputError` naming the field and its value.

A depth image holds the distance along the optical axis. With the pinhole camera
``u = fx x/z + cx``, ``v = fy y/z + cy`` (integer coordinates are pixel centres).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.types import DepthFrame
from depth_pose.io._virtual_camera import project_cloud

MAX_SIDE = 8192
"""The most rows or columns an image or cloud may have: larger sizes are damage. Set by hand."""

MAX_PIXELS = 16_777_216
"""The most pixels of an image, or points of a cloud: 4096 x 4096. Set by hand."""

_DEPTH_TYPES: dict[str, str] = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
_POINT_TYPES = {7: "f4", 8: "f8"}
"""NumPy's types of those of `sensor_msgs/PointField`'s numbers that a coordinate may have."""

_DISTORTION_LENGTHS = {"plumb_bob": (4, 5), "rational_polynomial": (8,), "equidistant": (4,)}
"""Coefficients that each model of ``sensor_msgs/distortion_models`` may have."""

_LEAST_FOCAL, _MOST_FOCAL = 0.05, 50.0
"""Bounds of the focal lengths, of the image's longer side: views of 169 and of 1.1 degrees. Sensors have 0.4
(fisheye) to 5 (long range). Set by hand."""

_MOST_ASPECT = 8.0
"""Most that the focal lengths may differ by, as a factor: images binned in one direction have 2.
Set by hand."""

_MOST_ELONGATED = 16
"""Most that an image's longer side may be of its shorter one. Of 8192 x 2 pixels a frame takes 20 s, of
8192 x 512 less than 0.1 s."""

_BAND = 64
"""Rows that are rectified at a time. Set by hand; not swept."""

_KEPT_PIXELS = MAX_PIXELS
"""Pixels of rectifications that are kept, of 9 bytes each: those of 54 cameras of 640 x 480. Set by hand."""

_FIT_TOLERANCE_PX = 0.5
"""A cloud whose points miss a pinhole camera's pixels by more, root mean square, has no such camera."""


def check_size(what: str, height: int, width: int, max_width: int = MAX_SIDE) -> None:
    """Refuse sizes of images and clouds that are empty, or too large to be one."""
    if height < 1 or width < 1:
        raise InputError(f"{what} is empty: width is {width}, height is {height}")
    if height > MAX_SIDE or width > max_width or height * width > MAX_PIXELS:
        raise InputError(
            f"{what} is too large: width is {width}, height is {height}; "
            f"the most is {max_width} x {MAX_SIDE} and {MAX_PIXELS} in all"
        )


def _check_shape(what: str, height: int, width: int) -> None:
    if max(height, width) > _MOST_ELONGATED * min(height, width):
        raise InputError(
            f"{what}: width is {width}, height is {height}; a camera's image is at most "
            f"{_MOST_ELONGATED} times as long as high"
        )


def _check_bytes(what: str, size: int, height: int, step: int, least_step: int, step_name: str) -> None:
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

    Returns
    -------
    (H, W) float32
        Metres, 0 where nothing returned (NaN, infinite or negative in the message; REP 118).

    Raises
    ------
    InputError
        Where the encoding holds no depth, or size, step and bytes disagree.
    """
    if encoding not in _DEPTH_TYPES:
        raise InputError(
            f"image: encoding is {encoding!r}; a depth image has one of {', '.join(_DEPTH_TYPES)}"
        )
    check_size("image", height, width)
    kind = np.dtype(("<", ">")[bool(is_bigendian)] + _DEPTH_TYPES[encoding])
    raw = np.frombuffer(data, np.uint8)
    _check_bytes("image", raw.nbytes, height, step, width * kind.itemsize, "step")
    pixels: NDArray[np.generic] = np.ndarray((height, width), kind, buffer=raw, strides=(step, kind.itemsize))
    if kind.kind == "u":
        metres: NDArray[np.float32] = pixels.astype(np.float32) / np.float32(1000.0)
        return metres
    depth: NDArray[np.float32] = pixels.astype(np.float32)
    depth[~(np.isfinite(depth) & (depth > 0))] = 0.0
    return depth


def camera_from_info(
    k: Sequence[float] | NDArray[np.float64],
    d: Sequence[float] | NDArray[np.float64],
    width: int,
    height: int,
    distortion_model: str = "plumb_bob",
) -> Camera:
    """Check the fields of a ``sensor_msgs/CameraInfo`` and give its pinhole camera.

    The lens' distortion is not part of a `Camera`: `rectify_depth` takes it out of the image.

    Parameters
    ----------
    k : (9,) float
        The matrix K, row by row.
    d : (n,) float
        Distortion coefficients; all zero, or none, where the image is rectified.
    width, height : int
        Size, pixels.
    distortion_model : str
        ``plumb_bob``, ``rational_polynomial`` or ``equidistant``; matters where `d` is not zero.

    Raises
    ------
    InputError
        Where a field is empty, zero or contradictory.
    """
    check_size("camera_info", height, width)
    _check_shape("camera_info", height, width)
    values = np.asarray(k, np.float64).ravel()
    if values.size != 9:
        raise InputError(f"camera_info: k has {values.size} numbers; it has 9")
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
    """Give the coefficients, checked; none where there is no distortion."""
    coefficients = tuple(float(x) for x in d)
    if not any(coefficients):
        return ()
    if not np.isfinite(coefficients).all():
        raise InputError(f"camera_info: d is {list(coefficients)}; all must be finite")
    if model not in _DISTORTION_LENGTHS:
        raise InputError(
            f"camera_info: distortion_model is {model!r}; it is one of {', '.join(_DISTORTION_LENGTHS)}, "
            "or give a rectified image and its camera_info"
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
    """Take the lens' distortion out of a depth image.

    Every pixel of the ideal camera takes the *nearest* pixel of the image: between two
    surfaces there is no depth to interpolate.

    Parameters
    ----------
    depth : (H, W) float32
        Metres.
    camera : Camera
        From `camera_from_info`; it is the result's camera too.
    d : (n,) float
        Distortion coefficients.
    distortion_model : str
        ``plumb_bob``, ``rational_polynomial`` or ``equidistant``.

    Returns
    -------
    (H, W) float32
        Metres; 0 where the sensor did not see. The input itself if there is no distortion.
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
    """Index of the distorted pixel that each ideal pixel sees, and whether there is none, (H, W)."""
    key = (camera, d, model)
    if key not in _rectifications:
        made = _make_rectification(camera, d, model)
        size = made[0].size
        while _rectifications and size + sum(s.size for s, _ in _rectifications.values()) > _KEPT_PIXELS:
            _rectifications.pop(next(iter(_rectifications)), None)
        _rectifications[key] = made
    return _rectifications[key]


_rectifications: dict[tuple[Camera, tuple[float, ...], str], tuple[NDArray[np.int64], NDArray[np.bool_]]] = {}
"""Those of the last cameras, up to `_KEPT_PIXELS`."""


def _make_rectification(
    camera: Camera, d: tuple[float, ...], model: str
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Work in bands of rows: what is between, in float64, is many times the size of the image."""
    source = np.zeros((camera.height, camera.width), np.int64)
    outside = np.zeros((camera.height, camera.width), np.bool_)
    u = np.arange(camera.width, dtype=np.float64)
    for first in range(0, camera.height, _BAND):
        band = slice(first, min(first + _BAND, camera.height))
        v = np.arange(band.start, band.stop, dtype=np.float64)[:, None]
        with np.errstate(all="ignore"):  # where a lens has no image; it is not inside then
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
    """Where a lens puts the ray (a, b, 1): the models of ``sensor_msgs/distortion_models``.

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


def decode_points(
    data: bytes | bytearray | memoryview | NDArray[np.uint8],
    height: int,
    width: int,
    point_step: int,
    row_step: int,
    fields: Mapping[str, tuple[int, int]],
    is_bigendian: bool | int = False,
) -> NDArray[np.float32]:
    """Read x, y, z of a ``sensor_msgs/PointCloud2``.

    Parameters
    ----------
    data : bytes-like
        The cloud's bytes, ``height * row_step`` of them.
    height, width : int
        Rows and columns; one row where the cloud is not organised.
    point_step, row_step : int
        Bytes of a point and of a row.
    fields : mapping of str to (int, int)
        Offset and datatype (`PointField`'s numbers) of each field.
    is_bigendian : bool or int
        Byte order.

    Returns
    -------
    (height, width, 3) float32
        Metres; NaN as in the message.
    """
    check_size("cloud", height, width, max_width=MAX_PIXELS)
    order = ("<", ">")[bool(is_bigendian)]
    raw = np.frombuffer(data, np.uint8)
    _check_bytes("cloud", raw.nbytes, height, row_step, width * point_step, "row_step")
    points = np.empty((height, width, 3), np.float32)
    for axis, name in enumerate("xyz"):
        if name not in fields:
            raise InputError(f"cloud has no field {name!r}; it has {', '.join(fields) or 'none'}")
        offset, datatype = fields[name]
        if datatype not in _POINT_TYPES:
            raise InputError(
                f"cloud: field {name!r} has datatype {datatype}; it is 7 (FLOAT32) or 8 (FLOAT64)"
            )
        kind = np.dtype(order + _POINT_TYPES[datatype])
        if offset < 0 or offset + kind.itemsize > point_step:
            raise InputError(
                f"cloud: field {name!r} at offset {offset} does not fit into point_step {point_step}"
            )
        points[..., axis] = np.ndarray(
            (height, width), kind, buffer=raw, offset=offset, strides=(row_step, point_step)
        )
    return points


def camera_from_points(points: NDArray[np.floating]) -> Camera:
    """Find the pinhole camera whose pixels an organised cloud's points are.

    Least squares in float64 of ``u = fx x/z + cx`` and ``v = fy y/z + cy`` over the points.

    Parameters
    ----------
    points : (h, w, 3) float
        Points in the optical frame, metres; NaN or z <= 0 where there is none.

    Raises
    ------
    InputError
        Where there are too few points, or no pinhole camera sees them so.
    """
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(f"cloud has shape {points.shape}; an organised one has (height, width, 3)")
    from depth_pose.io import _cloud_kernels as kernels

    height, width = points.shape[:2]
    _check_shape("cloud", height, width)
    sums, ends = np.empty((2, 5)), np.empty((2, 2), np.int64)
    count = kernels.pinhole_sums(points, sums, ends)
    lines = []
    for name, size, (low, high), row in zip(("columns", "rows"), (width, height), ends, sums, strict=True):
        if count < 3 or high - low < 2:
            raise InputError(f"cloud: {count} points are too few to find the camera from its {name}")
        ratio, pixel, ratio2, both, pixel2 = (row / count).tolist()
        spread = max(ratio2 - ratio * ratio, 1e-30)
        focal = (both - ratio * pixel) / spread
        error = float(np.sqrt(max(0.0, pixel2 - pixel * pixel - focal * focal * spread)))
        if not focal > 0 or not error < _FIT_TOLERANCE_PX:
            raise InputError(
                f"cloud: its {name} are not those of a pinhole camera looking along z "
                f"(focal length {focal:.3g} px, error {error:.2g} px)"
            )
        lines.append((focal, 0.5 * size + pixel - focal * ratio))
    (fx, cx), (fy, cy) = lines
    return Camera(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)


def frame_from_cloud(points: NDArray[np.floating], stamp_ns: int, frame_id: str) -> DepthFrame:
    """Make a depth image of a cloud.

    An organised cloud of a pinhole camera keeps its pixels. Any other is projected into a
    virtual pinhole camera at the origin of its frame, nearest point first, with as many
    pixels as suit its density.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3) float
        Points in an optical frame (x right, y down, z forward), metres; NaN where there is none.
    stamp_ns : int
    frame_id : str

    Raises
    ------
    InputError
        Where no point lies in front of the camera.
    """
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise InputError(f"cloud has shape {points.shape}; it has (height, width, 3) or (n, 3)")
    flat = points.reshape(-1, 3)
    flat = flat[np.isfinite(flat).all(axis=1) & (flat[:, 2] > 0)]
    if len(flat) == 0:
        raise InputError(
            "cloud has no point with z > 0: its frame must be an optical one (x right, y down, z forward)"
        )
    if points.ndim == 3 and min(points.shape[:2]) > 1:
        try:
            camera = camera_from_points(points)
        except InputError:
            pass  # organised, but by something else than a pinhole camera
        else:
            depth = points[..., 2].astype(np.float32)
            depth[~(np.isfinite(points).all(axis=2) & (depth > 0))] = 0.0
            return DepthFrame(stamp_ns, frame_id, depth, camera)
    depth, camera = project_cloud(flat)
    return DepthFrame(stamp_ns, frame_id, depth, camera)
