"""Point clouds: from message fields to points, and to the depth image of their camera.

The functions take plain fields, not messages, so that the nodes and the readers of recordings share them.
Invalid input raises `InputError` with the field and its value.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.image_size import MAX_PIXELS, check_shape, check_size
from depth_pose.io._virtual_camera import MAX_TANGENT, project_cloud
from depth_pose.io.decode import check_bytes

_POINT_TYPES = {7: "f4", 8: "f8"}
"""NumPy types of the `sensor_msgs/PointField` datatypes that a coordinate may have."""

OPTICAL = "_optical"
"""Suffix of a frame's name while a cloud of a body frame is turned to optical axes."""

R_BODY_OPTICAL: NDArray[np.float64] = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""Optical axes (x right, y down, z forward) to those of a body frame (x forward, y left, z up; REP 103)."""

BODY_AXES = "the cloud is in a body frame (x forward): it is turned, and skeletons are in the frame "
"""Warning of such clouds, before the frame's name."""

_JUDGED_POINTS = 4000
"""Number of points that tell the axes."""

_IN_VIEW, _OUT_OF_VIEW = 0.9, 0.5
"""Minimum share of the points in view with the right axes, and maximum with wrong ones; set by hand."""

_FIT_TOLERANCE_PX = 0.5
"""Maximum root mean square error (pixels) of a cloud's fit to a pinhole camera."""


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
        Rows and columns; one row if the cloud is not organised.
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
    check_bytes("cloud", raw.nbytes, height, row_step, width * point_step, "row_step")
    points = np.empty((height, width, 3), np.float32)
    for axis, name in enumerate("xyz"):
        if name not in fields:
            raise InputError(f"cloud has no field {name!r}; it has {', '.join(fields) or 'none'}")
        offset, datatype = fields[name]
        if datatype not in _POINT_TYPES:
            raise InputError(
                f"cloud: field {name!r} has datatype {datatype}; it must be 7 (FLOAT32) or 8 (FLOAT64)"
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


def is_body_frame(points: NDArray[np.floating]) -> bool:
    """Check whether a cloud has the axes of a body frame at the sensor: x forward, y left, z up (REP 103).

    Then the points fill a cone about x, and hardly one about z.

    Parameters
    ----------
    points : (..., 3) float
        NaN or infinite without a point.
    """
    return bool(share_in_view(points, 0) > _IN_VIEW and share_in_view(points, 2) < _OUT_OF_VIEW)


def share_in_view(points: NDArray[np.floating], axis: int) -> float:
    """Return the share of a cloud's points (..., 3) in a camera's view along an axis; 0 without points."""
    flat = points.reshape(-1, 3)
    flat = flat[:: max(1, len(flat) // _JUDGED_POINTS)]
    flat = flat[np.isfinite(flat).all(axis=1) & (flat != 0).any(axis=1)]
    beside = np.delete(flat, axis, axis=1)
    is_seen = (np.abs(beside) < MAX_TANGENT * flat[:, [axis]]).all(axis=1)
    return float(is_seen.mean()) if len(flat) else 0.0


def camera_from_points(points: NDArray[np.floating]) -> Camera:
    """Find the pinhole camera of an organised cloud.

    Least squares in float64 of ``u = fx x/z + cx`` and ``v = fy y/z + cy`` over the points.

    Parameters
    ----------
    points : (h, w, 3) float
        Points in the optical frame, metres; NaN or z <= 0 without a point.

    Raises
    ------
    InputError
        If there are too few points, or they do not fit a pinhole camera.
    """
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(f"cloud has shape {points.shape}; an organised cloud has (height, width, 3)")
    from depth_pose.io import _cloud_kernels as kernels

    height, width = points.shape[:2]
    check_shape("cloud", height, width)
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


def warm_up() -> None:
    """Compile the kernels of `camera_from_points`."""
    camera = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
    frame_from_cloud(camera.back_project(np.full((6, 8), 2.0, np.float32)), 0, "")


def frame_from_cloud(points: NDArray[np.floating], stamp_ns: int, frame_id: str) -> DepthFrame:
    """Convert a cloud to a depth image.

    A cloud in a body frame (x forward, y left, z up) is turned to optical axes, and its frame is called
    ``FRAME_optical``. An organised cloud of a pinhole camera keeps its pixels. Any other is projected into a
    virtual pinhole camera at the origin of its frame, nearest point first; its resolution fits their density.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3) float
        Points in an optical frame (x right, y down, z forward) or a body frame, metres; NaN without a point.
    stamp_ns : int
    frame_id : str

    Raises
    ------
    InputError
        If no point lies in front of the camera.
    """
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise InputError(f"cloud has shape {points.shape}; it must be (height, width, 3) or (n, 3)")
    if is_body_frame(points):
        points, frame_id = points @ R_BODY_OPTICAL.astype(points.dtype), frame_id + OPTICAL
    flat = points.reshape(-1, 3)
    flat = flat[np.isfinite(flat).all(axis=1) & (flat[:, 2] > 0)]
    if len(flat) == 0:
        raise InputError(
            "cloud has no point with z > 0: its frame must be an optical one (x right, y down, z forward) "
            "or a body frame at the sensor (x forward, y left, z up)"
        )
    in_view = share_in_view(points, 2)
    if points.ndim == 3 and min(points.shape[:2]) > 1:
        try:
            camera = camera_from_points(points)
        except InputError:
            pass  # organised, but not by a pinhole camera
        else:
            depth = points[..., 2].astype(np.float32)
            depth[~(np.isfinite(points).all(axis=2) & (depth > 0))] = 0.0
            return DepthFrame(stamp_ns, frame_id, depth, camera, in_view=in_view)
    depth, camera = project_cloud(flat)
    return DepthFrame(stamp_ns, frame_id, depth, camera, in_view=in_view)
