"""Placement of the virtual camera, and the room around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.rooms.rig import look_at
from depth_pose.sim.config import Placement, Room

_ROOM_HALF_WIDTH_M = 6.0
"""Half the width of floor and wall, and the wall's height, metres: more than any sensor sees."""


def camera_pose(placement: Placement, target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the transform from the room to the camera.

    Parameters
    ----------
    placement : Placement
        The camera's position.
    target : (3,) float64
        The spot it looks toward, model frame (y up, floor at 0), metres; its height is not used.

    Returns
    -------
    (4, 4) float64
        ``T_camera_model``, rotation and translation.
    """
    azimuth, pitch, roll = np.deg2rad([placement.azimuth, placement.pitch, placement.roll])
    outward = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
    position = np.array([target[0], placement.height, target[2]]) + placement.distance * outward
    forward = -outward * np.cos(pitch) - np.array([0.0, np.sin(pitch), 0.0])
    turn, c, s = np.eye(4), np.cos(roll), np.sin(roll)
    turn[:2, :2] = [[c, s], [-s, c]]
    return np.asarray(turn @ look_at(position, position + forward))


def room_mesh(
    room: Room, placement: Placement, target: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Make the floor and the wall.

    Parameters
    ----------
    room : Room
        The parts of the room.
    placement : Placement
        The wall stands across this camera's view.
    target : (3,) float64
        The spot that the camera looks toward, model frame, metres.

    Returns
    -------
    vertices : (V, 3) float32
        Model frame, metres; none for an empty room.
    faces : (F, 3) uint32
    """
    azimuth = np.deg2rad(placement.azimuth)
    outward = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
    aside = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)]) * _ROOM_HALF_WIDTH_M
    spot = np.array([target[0], 0.0, target[2]])
    back = spot - (room.wall or _ROOM_HALF_WIDTH_M) * outward
    front = spot + (placement.distance + _ROOM_HALF_WIDTH_M) * outward
    up = np.array([0.0, _ROOM_HALF_WIDTH_M, 0.0])
    quads = []
    if room.floor:
        quads.append([back - aside, back + aside, front + aside, front - aside])
    if room.wall:
        quads.append([back - aside, back + aside, back + aside + up, back - aside + up])
    vertices = np.array(quads, np.float32).reshape(-1, 3)
    first = 4 * np.arange(len(quads))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3).astype(np.uint32)
    return vertices, faces
