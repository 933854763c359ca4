"""One camera's view of one person, with the camera's pose at that moment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.skeleton import Nodes
from depth_pose.track.person_view import PersonView
from depth_pose.track.target import FitTarget


@dataclass(frozen=True, eq=False)
class View:
    """A person's data from one camera, at the camera's own time.

    The person moves between the stamps of two cameras. All views of a frame refer to one time, so the
    camera's pose is shifted by the person's displacement instead.

    Attributes
    ----------
    person : PersonView
        In the camera's frame.
    target : FitTarget
    T_room_camera : (4, 4) float64
        Optical frame to the room's, for the person where they are at the common time.
    """

    person: PersonView
    target: FitTarget
    T_room_camera: NDArray[np.float64]

    @cached_property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation (3, 3) of vectors of the room to the camera."""
        return np.ascontiguousarray(self.T_room_camera[:3, :3].T)

    @cached_property
    def area(self) -> float:
        """Visible area of the person, perpendicular to the rays, square metres."""
        camera = self.person.camera
        return float((self.person.points[:, 2] ** 2).sum() / (camera.fx * camera.fy))

    def to_camera(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) of the room in the camera's frame, metres."""
        return np.asarray((points - self.T_room_camera[:3, 3]) @ self.rotation.T)

    def to_room(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) of the camera's frame in the room, metres."""
        return np.asarray(points @ self.rotation + self.T_room_camera[:3, 3])

    def pose_in_camera(self, pose: BodyPose) -> BodyPose:
        """Return a pose of the room in the camera's frame."""
        return BodyPose(self.rotation @ pose.rotations, self.to_camera(pose.root), pose.scale)

    def pose_in_room(self, pose: BodyPose) -> BodyPose:
        """Return a pose of the camera's frame in the room."""
        return BodyPose(self.rotation.T @ pose.rotations, self.to_room(pose.root), pose.scale)

    def body_in_camera(self, body: FittedBody) -> FittedBody:
        """Return a body of the room in the camera's frame."""
        return FittedBody(
            self.pose_in_camera(body.pose), self.to_camera(body.vertices), Nodes(self.to_camera(body.nodes))
        )


def view_at(
    person: PersonView, target: FitTarget, T_room_camera: NDArray[np.float64], way: NDArray[np.float64]
) -> View:
    """Return a person's view at another time.

    Parameters
    ----------
    person : PersonView
    target : FitTarget
    T_room_camera : (4, 4) float64
        Of the camera.
    way : (3,) float64
        The person's displacement from the camera's stamp to the common time, room frame, metres.
    """
    T = T_room_camera.copy()
    T[:3, 3] += way
    return View(person, target, T)
