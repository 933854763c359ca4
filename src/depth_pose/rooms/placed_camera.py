"""One camera of a rig: skeletons of the room in the camera's frame and clock."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.result import Skeleton
from depth_pose.rooms.merge import place
from depth_pose.rooms.recorded import RecordedPeople
from depth_pose.rooms.rig import T_WORLD_ROOM, RigCamera
from depth_pose.rooms.rigfile import Rig

Answer = Callable[[DepthFrame], tuple[Skeleton, ...] | None]
"""Returns the skeletons of a frame; None if it was not answered."""


@dataclass(frozen=True)
class PlacedCamera:
    """A camera, its pose in the room, and its clock offset.

    Attributes
    ----------
    camera : RigCamera
    clock_offset_s : float
        Its clock minus the room's, seconds.
    """

    camera: RigCamera
    clock_offset_s: float = 0.0

    @property
    def T_room_camera(self) -> NDArray[np.float64]:
        """Optical frame to the room's, (4, 4)."""
        return self.camera.T_room_camera

    def room_stamp(self, stamp_ns: int) -> int:
        """Return the camera's stamp in the room's clock."""
        return stamp_ns - round(self.clock_offset_s * 1e9)

    def to_camera(self, points_room: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) of the room in the optical frame, metres."""
        T = self.T_room_camera
        return np.asarray((points_room - T[:3, 3]) @ T[:3, :3])

    def answer(self, people: RecordedPeople, frame: DepthFrame) -> tuple[Skeleton, ...] | None:
        """Return everybody in the room at the time of a frame, in its optical frame.

        Raises
        ------
        InputError
            Where the image is not of the camera's size.
        """
        self.camera.check_size(*frame.depth.shape)
        skeletons = people.at(self.room_stamp(frame.stamp_ns))
        T_camera_room = self.camera.T_camera_world @ T_WORLD_ROOM
        if skeletons is None:
            return None
        moved = (place(s, T_camera_room, frame.frame_id) for s in skeletons)
        return tuple(replace(s, stamp_ns=frame.stamp_ns) for s in moved)


def answers_in_frames(people: RecordedPeople, camera: PlacedCamera | None) -> Answer:
    """Return the function that gives a depth frame's skeletons, in its optical frame.

    Parameters
    ----------
    people : RecordedPeople
        In a room's frame, or in that of the depth frames.
    camera : PlacedCamera, optional
        The camera of the depth frames; needed for skeletons in a room's frame.

    Raises
    ------
    ConfigError
        Where it is needed and not given.
    """
    if not people.is_room:
        return lambda frame: people.answers.get(frame.stamp_ns)
    if camera is None:
        raise ConfigError(
            f"the skeletons of {people.path} are in a room's frame: give the rig file of its cameras, --rig"
        )
    return lambda frame: camera.answer(people, frame)


def choose_camera(rig: Rig, rig_file: Path, recording: Path, name: str | None = None) -> PlacedCamera:
    """Return the camera of a rig that made a recording.

    Parameters
    ----------
    rig : Rig
    rig_file : Path
        For messages.
    recording : Path
        Without a name the camera is the one called as the recording, or whose name ends with the same number
        (``camera1`` and ``hall_1.mcap``), or the only one.
    name : str, optional
        The camera's name, or its number in the rig, from 0.

    Raises
    ------
    ConfigError
        Where there is no such camera, or nothing tells which one it is.
    """
    names = [camera.name for camera in rig.cameras]
    if name is not None:
        found = [i for i, known in enumerate(names) if known == name]
        found = found or [i for i in range(len(names)) if str(i) == name]
        problem = f"{rig_file} has no camera {name!r}"
    else:
        stem = recording.resolve().stem
        number = _last_number(stem)
        found = [i for i, known in enumerate(names) if known == stem]
        found = found or [i for i, known in enumerate(names) if number and _last_number(known) == number]
        found = found or list(range(len(names)))
        problem = f"nothing tells which camera of {rig_file} made {recording}: name it with --camera"
    if len(found) != 1:
        raise ConfigError(f"{problem}; its cameras are {', '.join(names)}")
    return PlacedCamera(rig.cameras[found[0]], rig.clock_offsets[found[0]])


def _last_number(name: str) -> str:
    """Return the digits at the end of a name, without leading zeros; empty if there are none."""
    digits = re.search(r"\d+$", name)
    return str(int(digits[0])) if digits else ""
