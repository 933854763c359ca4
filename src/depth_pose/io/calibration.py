"""Camera calibrations of images: the pinhole camera and the lens, from the fields of a CameraInfo.

`depth_pose.core.camera_info` reads and checks the fields.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera, Lens
from depth_pose.core.camera_info import check_pinhole, read_camera_info


def is_rectified(topic: str) -> bool:
    """Check that a topic's images are rectified, by its name: ``image_rect``, ``image_depth_rect``.

    By the convention of ``image_proc`` their CameraInfo is that of the raw image: K and D describe the lens,
    and P the rectified image.
    """
    return "rect" in topic.removesuffix("/compressedDepth").removesuffix("/compressed").rpartition("/")[
        2
    ].split("_")


def lens_of_image(info: Any, height: int, width: int, rectified: bool = False) -> Lens:
    """Return the lens of an image from its ``sensor_msgs/CameraInfo``.

    Parameters and errors are those of `depth_pose.core.camera_info.read_camera_info`.
    """
    pinhole, model, d = read_camera_info(info, height, width, rectified)
    return Lens(Camera(*pinhole), model, d)


def camera_of_rectified(info: Any) -> Camera:
    """Return the camera of images without distortion, of the size that their CameraInfo defines.

    Raises
    ------
    InputError
        As `lens_of_image`.
    """
    roi = info.roi
    width, height = (roi.width, roi.height) if roi.width and roi.height else (info.width, info.height)
    size = height // max(1, info.binning_y), width // max(1, info.binning_x)
    return lens_of_image(info, *size, rectified=not np.any(info.k)).camera


def camera_from_info(
    k: Sequence[float] | NDArray[np.float64],
    d: Sequence[float] | NDArray[np.float64],
    width: int,
    height: int,
    distortion_model: str = "plumb_bob",
) -> Camera:
    """Return the pinhole camera of a ``sensor_msgs/CameraInfo``, checked.

    Parameters and errors are those of `depth_pose.core.camera_info.check_pinhole`.
    """
    return Camera(*check_pinhole(k, d, width, height, distortion_model))
