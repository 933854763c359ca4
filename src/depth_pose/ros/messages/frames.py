"""Conversion of sensor messages to depth frames."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

from depth_pose.core.frame import DepthFrame
from depth_pose.io.calibration import lens_of_image
from depth_pose.io.clouds import decode_points, frame_from_cloud
from depth_pose.io.compressed import decode_compressed_depth
from depth_pose.io.decode import decode_depth, is_order_wrong
from depth_pose.io.rectification import rectify_depth
from depth_pose.ros.messages.basics import stamp_to_ns


def image_to_frame(
    msg: Image | CompressedImage, info: CameraInfo, rectified: bool = False, unit_m: float | None = None
) -> DepthFrame:
    """Convert an image, compressed or not, and its ``CameraInfo`` to a depth frame without lens distortion.

    A rectified image (`depth_pose.io.calibration.is_rectified`) has none. ``unit_m`` is metres per unit of
    the depth, where it is not the encoding's.

    Raises
    ------
    InputError
        If the encoding, the size or the camera cannot be used.
    """
    if isinstance(msg, CompressedImage):
        depth = decode_compressed_depth(msg.format, memoryview(msg.data), unit_m)
    else:
        size = (msg.height, msg.width, msg.step, msg.encoding)
        is_big = bool(msg.is_bigendian) != has_wrong_order(msg)
        depth = decode_depth(memoryview(msg.data), *size, is_big, unit_m)
    ideal = rectify_depth(depth, lens_of_image(info, depth.shape[0], depth.shape[1], rectified))
    return DepthFrame(
        stamp_to_ns(msg.header.stamp), msg.header.frame_id, ideal.depth, ideal.camera, ideal.filled
    )


def has_wrong_order(msg: Image) -> bool:
    """Check whether an image has the other byte order than it says."""
    size = (msg.height, msg.width, msg.step, msg.encoding)
    return is_order_wrong(memoryview(msg.data), *size, bool(msg.is_bigendian))


def msg_to_frame(msg: PointCloud2, unit_m: float | None = None) -> DepthFrame:
    """Convert a point cloud in its optical frame, organised or not, by default in metres, to a depth frame.

    Raises
    ------
    InputError
        If the cloud has no usable coordinates.
    """
    points = decode_points(
        memoryview(msg.data),
        msg.height,
        msg.width,
        msg.point_step,
        msg.row_step,
        {f.name: (f.offset, f.datatype) for f in msg.fields},
        bool(msg.is_bigendian),
    )
    if unit_m is not None:
        points *= np.float32(unit_m)
    return frame_from_cloud(points, stamp_to_ns(msg.header.stamp), msg.header.frame_id)
