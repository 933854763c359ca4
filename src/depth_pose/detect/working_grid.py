"""Working grid of all later steps: the image, reduced to about the required number of rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.detect import _reduce_kernels as kernels
from depth_pose.detect.tuning import DetectTuning

_LEAST_FOCAL = 0.44
"""Least focal length on the grid, as a share of the required rows; wider views are reduced less. At 3 m a
forearm is then two pixels wide."""


def reduce_camera(camera: Camera, stride: int) -> Camera:
    """Return the camera whose pixels are blocks of ``stride`` x ``stride`` pixels."""
    return Camera(
        width=camera.width // stride,
        height=camera.height // stride,
        fx=camera.fx / stride,
        fy=camera.fy / stride,
        cx=(camera.cx - (stride - 1) / 2) / stride,
        cy=(camera.cy - (stride - 1) / 2) / stride,
    )


def reduce_frame(
    frame: DepthFrame, config: SegmentConfig, tuning: DetectTuning = DetectTuning()
) -> tuple[NDArray[np.float32], Camera]:
    """Reduce a frame to the working grid.

    Returns
    -------
    depth : (h, w) float32
        Metres; 0 without a measurement within the distance limits.
    camera : Camera
    """
    camera = frame.camera
    least_focal = _LEAST_FOCAL * config.working_height
    stride = max(1, min(round(camera.height / config.working_height), int(camera.fx / least_focal)))
    if stride == 1:
        return kernels.clip_depth(frame.depth, config.near, config.far), camera
    depth = kernels.reduce_depth(frame.depth, stride, tuning.depth_jump, config.near, config.far)
    return depth, reduce_camera(camera, stride)


def warm_up(config: SegmentConfig) -> None:
    """Compile the kernels for reduced and for unreduced images."""
    for side in (8, 2 * config.working_height):
        depth = np.full((side, 8), 2.0, np.float32)
        reduce_frame(DepthFrame(0, "", depth, Camera(8, side, 200.0, 200.0, 3.5, 0.5 * side)), config)
