"""One depth image with its camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError


@dataclass(frozen=True)
class DepthFrame:
    """One depth image.

    Attributes
    ----------
    stamp_ns : int
        The sensor's time stamp, nanoseconds.
    frame_id : str
        Name of the optical frame.
    depth : (H, W) float32
        Distance along the optical axis, metres; 0 or NaN where nothing returned.
    camera : Camera
    filled : float
        Share of the image that the sensor sees; less than 1 where it was rotated.
    in_view : float
        Share of a point cloud's points that lie in view of the camera; 1 of an image.

    Raises
    ------
    InputError
        Where depth is not float32, or not of the camera's size.
    """

    stamp_ns: int
    frame_id: str
    depth: NDArray[np.float32]
    camera: Camera
    filled: float = 1.0
    in_view: float = 1.0

    def __post_init__(self) -> None:
        if self.depth.dtype != np.float32:
            raise InputError(f"depth has dtype {self.depth.dtype}; a DepthFrame has float32 metres")
        if self.depth.shape != (self.camera.height, self.camera.width):
            raise InputError(
                f"depth has shape {self.depth.shape}, the camera's image "
                f"{(self.camera.height, self.camera.width)}: rows, columns"
            )
