"""A room whose floor and cameras are known: its skeletons with one camera's depth, or alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.types import DepthFrame, Skeleton
from depth_pose.rooms.merge import place
from depth_pose.rooms.recorded import RecordedPeople
from depth_pose.rooms.rig import RigCamera
from depth_pose.viewer.source import RecordedSource

_EYE_HEIGHT_M = 1.5
"""Height of the virtual sensor above the origin of a room without a rig (m); for readability."""

_NO_IMAGE = Camera(1, 1, 1.0, 1.0, 0.0, 0.0)
"""Camera of the empty depth image, for frames without depth."""


@dataclass(frozen=True, eq=False)
class KnownRoom:
    """The room of a scene.

    Attributes
    ----------
    T_room_sensor : (4, 4) float64
        From the frame of depth and skeletons to the room's: z up, the floor at z = 0.
    cameras : tuple of RigCamera
        All cameras, to be drawn.
    """

    T_room_sensor: NDArray[np.float64]
    cameras: tuple[RigCamera, ...] = ()


def level_sensor() -> NDArray[np.float64]:
    """Return ``T_room_sensor`` of a level sensor above the room's origin that looks along x."""
    return np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, _EYE_HEIGHT_M], [0, 0, 0, 1]])


def source_without_depth(people: RecordedPeople, room: KnownRoom) -> RecordedSource:
    """Return the frames of skeletons in the room's frame, without depth."""
    T_sensor_room = np.asarray(np.linalg.inv(room.T_room_sensor), np.float64)

    def frames() -> Iterator[DepthFrame]:
        for stamp_ns in people.stamps_ns:
            yield DepthFrame(stamp_ns, "sensor", np.zeros((1, 1), np.float32), _NO_IMAGE)

    def answer(frame: DepthFrame) -> tuple[Skeleton, ...]:
        return tuple(place(s, T_sensor_room, frame.frame_id) for s in people.answers[frame.stamp_ns])

    return RecordedSource(frames(), answer, 1, room)
