"""Places for cameras in a furnished room: near walls, off the people's paths, with the people in view.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.rooms.rig import look_at
from depth_pose.sim.play import Cast, person_at
from depth_pose.sim.rooms import Room
from depth_pose.sim.scene_view import View, draw
from depth_pose.sim.shapes import Triangles

Array = NDArray[np.float64]

_HEIGHTS_M = (1.0, 2.6)
"""Range of heights above the floor, metres."""
_AIMS_M = (0.7, 1.2)
"""Range of heights that cameras look at, metres."""
_AWAY_M = (2.3, 4.5)
"""Range of distances from the middle of the people's paths; walls may be nearer, metres."""
_AHEAD_M = (0.0, 3.0)
"""Spot, x and z, that cameras look at where there are no people, metres."""
_ROLL_DEG = 2.0
"""Standard deviation of the cameras' roll, degrees."""
_STEP_M = 0.05
"""Steps in which a wall is approached, metres."""
_FROM_WALL_M, _FROM_CEILING_M = 0.12, 0.1
"""Minimum distances of cameras from walls and ceiling, metres."""
_FROM_PEOPLE_M = 0.7
"""Minimum distance of people's paths from a camera, metres."""
_APART_DEG = 40.0
"""Minimum angle between two cameras, seen from the middle of the paths, degrees."""
_LOOK_EVERY_S = 2.0
"""Time between the moments at which a camera must see people, seconds."""
_SEES_SHARE = 0.6
"""Share of joints, over all moments, that a camera must see."""
_CLOSE_M, _CLOSE_SHARE = 0.8, 0.03
"""Maximum share of an image with surfaces nearer than this distance (m)."""
_TRIES = 150
"""Maximum number of places tried for a camera; the best is kept where none suffices."""
_SMALL_PX = 80
"""Width of the images that places are judged by, pixels."""
_JOINT_SLACK_M = 0.25
"""A joint lies at most this far behind its own surface, metres."""


class Places:
    """Finds places for cameras around people, and judges them by small images without noise.

    Parameters
    ----------
    room : Room
    surfaces : Triangles
        The furnished room, room frame.
    cast : sequence of (Performer, Track)
        The people; without any, cameras look at a spot ahead of camera 0.
    """

    def __init__(self, room: Room, surfaces: Triangles, cast: Cast) -> None:
        self._room, self._surfaces = room, surfaces
        self._spots = np.concatenate([track.spots for _, track in cast]) if cast else np.array([_AHEAD_M])
        x, z = self._spots.mean(axis=0)
        self._middle = np.array([x, 0.0, z])
        joints = [
            person_at(p, track, t).joints
            for p, track in cast
            for t in range(0, len(track.spots), round(_LOOK_EVERY_S * p.fps))
        ]
        self._joints = np.concatenate(joints) if joints else np.array([[x, _AIMS_M[1], z]])

    def find(self, rng: np.random.Generator, camera: Camera, others: Sequence[View]) -> View:
        """Sample places until a camera sees the people from a new side.

        Parameters
        ----------
        rng : numpy.random.Generator
        camera : Camera
            Its intrinsics.
        others : sequence of View
            The cameras that have a place.

        Returns
        -------
        View
            The first place that suffices; the best of all where none does.
        """
        best, most = others[0], -np.inf
        for k in range(_TRIES):
            view = self._sample(rng, camera)
            apart = _APART_DEG * (1.0 - k / _TRIES)  # a small room may have less space
            fits = self._is_free(view) and self._angle(view, others) >= np.deg2rad(apart)
            score = self._share_seen(view) - (not fits)
            if score > most:
                best, most = view, score
            if score >= _SEES_SHARE:
                break
        return best

    def _sample(self, rng: np.random.Generator, camera: Camera) -> View:
        """Sample a place beside the people's paths, inside the room, and look at their middle."""
        azimuth = rng.uniform(-np.pi, np.pi)
        way = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
        position = self._middle + self._reach(way, rng.uniform(*_AWAY_M)) * way
        top = min(_HEIGHTS_M[1], self._room.walls.height - _FROM_CEILING_M)
        position[1], target = rng.uniform(_HEIGHTS_M[0], top), self._middle.copy()
        target[1], roll = rng.uniform(*_AIMS_M), rng.normal(0.0, np.deg2rad(_ROLL_DEG))
        c, s = np.cos(roll), np.sin(roll)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return View(camera, turn @ look_at(position, target)[:3, :3], position)

    def _reach(self, way: Array, wanted: float) -> float:
        """Return the distance from the middle to a wall in a direction, or the wanted one if less."""
        reach = 0.0
        for step in np.arange(0.0, wanted, _STEP_M):
            x, _, z = self._middle + step * way
            if self._room.walls.inward(x, z) <= _FROM_WALL_M:
                break
            reach = float(step)
        return reach

    def _is_free(self, view: View) -> bool:
        """Whether nobody walks into the camera."""
        away = np.linalg.norm(self._spots - view.position[[0, 2]], axis=1)
        return bool(away.min() > _FROM_PEOPLE_M)

    def _angle(self, view: View, others: Sequence[View]) -> float:
        """Return the smallest angle between a camera and others about the middle, radians."""
        azimuth, *taken = (np.arctan2(*(v.position - self._middle)[[0, 2]]) for v in (view, *others))
        return float(np.abs((azimuth - np.array(taken) + np.pi) % (2 * np.pi) - np.pi).min())

    def _share_seen(self, view: View) -> float:
        """Return the share of all joints that the room does not hide; 0 for an obstructed camera."""
        c, scale = view.camera, _SMALL_PX / view.camera.width
        tall = round(c.height * scale)
        small = Camera(_SMALL_PX, tall, c.fx * scale, c.fy * scale, c.cx * scale, c.cy * scale)
        depth = draw(view.to_optical(self._surfaces.vertices), self._surfaces.faces, small).depth
        if np.mean((depth > 0) & (depth < _CLOSE_M)) > _CLOSE_SHARE:
            return 0.0
        joints = view.to_optical(self._joints)
        pixels = np.rint(np.nan_to_num(replace(view, camera=small).project(joints), nan=-1.0))
        inside = np.all((pixels >= 0) & (pixels < [_SMALL_PX, tall]), axis=1)
        u, v = pixels[inside].astype(np.int64).T
        shown = (depth[v, u] <= 0) | (depth[v, u] > joints[inside, 2] - _JOINT_SLACK_M)
        return float(shown.sum() / len(joints))
