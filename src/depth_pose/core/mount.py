"""Sensors that are mounted upside down, on their side or rolled.

All steps assume that the top of the image is up. So frames of a rolled sensor are rotated upright about
the optical axis, which changes no depth, and skeletons are rotated back into the sensor's own frame.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import MountConfig
from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.result import Skeleton

UPRIGHT = "_upright"
"""Suffix of a frame's name while it is rotated upright."""


def rotation_sensor_upright(roll_deg: float) -> NDArray[np.float64]:
    """``R_sensor_upright``: exact for quarters of a turn."""
    turn = np.radians(roll_deg)
    c, s = np.cos(turn), np.sin(turn)
    if roll_deg % 90.0 == 0.0:
        c, s = np.round(c), np.round(s)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def up_direction(config: MountConfig) -> NDArray[np.float64]:
    """Return the direction of up in the upright frame by ``mount.pitch``, unit vector (3,)."""
    pitch = np.radians(config.pitch)
    return np.array([0.0, -np.cos(pitch), -np.sin(pitch)])


def rotate_upright(frame: DepthFrame, config: MountConfig) -> DepthFrame:
    """Rotate a frame upright; each pixel takes the nearest of the sensor's."""
    if config.roll % 360.0 == 0.0:
        return frame
    camera, source, inside = _lookup(frame.camera, config.roll)
    depth = np.where(inside, frame.depth.ravel()[source], np.float32(0.0))
    turned_id, filled = frame.frame_id + UPRIGHT, float(inside.mean())
    return replace(frame, frame_id=turned_id, depth=depth, camera=camera, filled=filled)


def sensor_frame(frame_id: str, config: MountConfig) -> str:
    """Return the name of the sensor's frame from that of the upright one."""
    return frame_id if config.roll % 360.0 == 0.0 else frame_id.removesuffix(UPRIGHT)


def check_upright(frame_id: str, config: MountConfig) -> None:
    """Check that data from a rolled sensor was rotated upright with this setting.

    Without a roll nothing is rotated back: results stay in the frame named in their header.

    Raises
    ------
    InputError
        If it has not been.
    """
    if config.roll % 360.0 != 0.0 and not frame_id.endswith(UPRIGHT):
        raise InputError(
            f"mount.roll is {config.roll:g} here, and {frame_id!r} is not upright: set it for all nodes"
        )


def rotate_to_sensor(skeleton: Skeleton, config: MountConfig) -> Skeleton:
    """Return a skeleton of an upright frame in the sensor's frame."""
    if config.roll % 360.0 == 0.0:
        return skeleton
    rotation = rotation_sensor_upright(config.roll)
    return skeleton.turned(rotation, np.zeros(3), sensor_frame(skeleton.frame_id, config))


@lru_cache(maxsize=8)
def _lookup(camera: Camera, roll_deg: float) -> tuple[Camera, NDArray[np.int64], NDArray[np.bool_]]:
    """Camera of the upright image, and for each of its pixels that of the sensor, and whether it exists."""
    rotation = rotation_sensor_upright(roll_deg)[:2, :2]
    fx = float(np.hypot(camera.fx * rotation[0, 0], camera.fy * rotation[1, 0]))
    fy = float(np.hypot(camera.fx * rotation[0, 1], camera.fy * rotation[1, 1]))
    columns = np.array([-0.5, camera.width - 0.5, -0.5, camera.width - 0.5])
    rows = np.array([-0.5, -0.5, camera.height - 0.5, camera.height - 0.5])
    corners = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy])
    x, y = rotation.T @ corners
    width, height = round(fx * float(np.ptp(x))), round(fy * float(np.ptp(y)))
    upright = Camera(width, height, fx, fy, -0.5 - fx * float(x.min()), -0.5 - fy * float(y.min()))
    v, u = np.mgrid[:height, :width].astype(np.float64)
    rays = np.stack([(u - upright.cx) / fx, (v - upright.cy) / fy]).reshape(2, -1)
    a, b = rotation @ rays
    column = np.rint(camera.fx * a + camera.cx).astype(np.int64).reshape(height, width)
    row = np.rint(camera.fy * b + camera.cy).astype(np.int64).reshape(height, width)
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    return upright, np.where(inside, row * camera.width + column, 0), inside
