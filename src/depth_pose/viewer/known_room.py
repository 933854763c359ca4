"""A room whose floor and cameras are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.rooms.rig import RigCamera

_EYE_HEIGHT_M = 1.5
"""Height of the virtual sensor above the origin of a room without a rig (m); for readability."""


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
