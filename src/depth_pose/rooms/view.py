"""One person as one camera of a room sees them, with the camera's place at that moment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.pose import BodyPose
from depth_pose.track.person import Person
from depth_pose.track.target import FitTarget


@dataclass(frozen=True, eq=False)
class View:
    """A person's data from one camera, at the camera's own time.

    The person moves on between the stamps of two cameras. All views of a frame hold for one time, so the
    camera is placed as if it had moved in the person's stead.

    Attributes
    ----------
    person : Person
        In the camera's frame.
    target : FitTarget
    T_camera_room : (4, 4) float64
        Room to optical frame, for the person where they are at the common time.
    """

    person: Person
    target: FitTarget
    T_camera_room: NDArray[np.float64]

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Room to optical frame, (3, 3)."""
        return np.ascontiguousarray(self.T_camera_room[:3, :3])

    @cached_property
    def area(self) -> float:
        """Surface of the person that the camera sees, square metres across its rays."""
        camera = self.person.camera
        return float((self.person.points[:, 2] ** 2).sum() / (camera.fx * camera.fy))

    def pose_in_camera(self, pose: BodyPose) -> BodyPose:
        """Return a pose of the room in the camera's frame."""
        T = self.T_camera_room
        return BodyPose(T[:3, :3] @ pose.rotations, T[:3, :3] @ pose.root + T[:3, 3], pose.scale)

    def pose_in_room(self, pose: BodyPose) -> BodyPose:
        """Return a pose of the camera's frame in the room."""
        T = self.T_camera_room
        return BodyPose(T[:3, :3].T @ pose.rotations, T[:3, :3].T @ (pose.root - T[:3, 3]), pose.scale)

    def to_camera(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) of the room in the camera's frame, metres."""
        return np.asarray(points @ self.T_camera_room[:3, :3].T + self.T_camera_room[:3, 3])

    def to_room(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) of the camera's frame in the room, metres."""
        return np.asarray((points - self.T_camera_room[:3, 3]) @ self.T_camera_room[:3, :3])


def view_at(
    person: Person,
    target: FitTarget,
    T_camera_room: NDArray[np.float64],
    velocity: NDArray[np.float64],
    seconds: float,
) -> View:
    """Return a person's view at another time.

    Parameters
    ----------
    person : Person
    target : FitTarget
    T_camera_room : (4, 4) float64
        Of the camera.
    velocity : (3,) float64
        The person's, room frame, m/s.
    seconds : float
        From the camera's stamp to the common time.
    """
    T = T_camera_room.copy()
    T[:3, 3] -= T[:3, :3] @ (velocity * seconds)
    return View(person, target, T)
