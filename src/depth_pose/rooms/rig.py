"""Calibrated cameras around one space.

The *world* frame has y up and the floor at y = 0, as the model frame has; metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError

ROOM_FRAME = "room"
"""Name of the room's frame: z up, the floor at z = 0."""

T_WORLD_ROOM: NDArray[np.float64] = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
"""From the room's frame, x forward, y left, z up, to the world's: x left, y up, z forward."""


@dataclass(frozen=True, eq=False)
class RigCamera:
    """One camera and its pose.

    Attributes
    ----------
    name : str
    camera : Camera
    T_camera_world : (4, 4) float64
        World to optical frame.
    """

    name: str
    camera: Camera
    T_camera_world: NDArray[np.float64]

    def __post_init__(self) -> None:
        T = np.asarray(self.T_camera_world, np.float64)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise ConfigError(f"camera {self.name}: T_camera_world must be a finite 4 x 4 matrix")
        if not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-4) or np.linalg.det(T[:3, :3]) < 0:
            raise ConfigError(f"camera {self.name}: T_camera_world does not hold a rotation")
        object.__setattr__(self, "T_camera_world", T)

    @property
    def T_room_camera(self) -> NDArray[np.float64]:
        """Optical frame to the room's frame, which is the world's with z up (REP 103), shape (4, 4)."""
        return np.asarray(np.linalg.inv(self.T_camera_world @ T_WORLD_ROOM))

    @property
    def position(self) -> NDArray[np.float64]:
        """Position of the pinhole in the world frame, shape (3,), metres."""
        T = self.T_camera_world
        return np.asarray(-T[:3, :3].T @ T[:3, 3])

    def to_camera(self, points_world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) in the optical frame, metres."""
        T = self.T_camera_world
        return np.asarray(points_world @ T[:3, :3].T + T[:3, 3])

    def to_world(self, points_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) in the world frame, metres."""
        T = self.T_camera_world
        return np.asarray((points_camera - T[:3, 3]) @ T[:3, :3])

    def check_size(self, height: int, width: int) -> None:
        """Raise InputError where an image is not of the camera's size."""
        if (height, width) != (self.camera.height, self.camera.width):
            raise InputError(
                f"the image of {self.name} is {width} x {height}; "
                f"its camera's images are {self.camera.width} x {self.camera.height}"
            )

    def points_world(self, depth: NDArray[np.generic]) -> NDArray[np.float64]:
        """Points (N, 3) of a depth image's pixels with a return, world frame, metres."""
        points = self.camera.back_project(np.asarray(depth, np.float32)).astype(np.float64)
        return self.to_world(points[np.isfinite(points).all(axis=-1)])


def check_images(images: Sequence[Any], cameras: Sequence[RigCamera]) -> None:
    """Raise InputError unless there is one image per camera (None: missing), of the camera's size."""
    if len(images) != len(cameras):
        raise InputError(f"{len(images)} images for {len(cameras)} cameras")
    for image, rig in zip(images, cameras, strict=True):
        if image is not None:
            rig.check_size(*image.shape)


def look_at(
    position: NDArray[np.float64] | Sequence[float], target: NDArray[np.float64] | Sequence[float]
) -> NDArray[np.float64]:
    """``T_camera_world`` of an upright camera at a position that looks toward a target."""
    eye = np.asarray(position, np.float64)
    forward = np.asarray(target, np.float64) - eye
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    T_camera_world = np.eye(4)
    T_camera_world[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    T_camera_world[:3, 3] = -T_camera_world[:3, :3] @ eye
    return T_camera_world
