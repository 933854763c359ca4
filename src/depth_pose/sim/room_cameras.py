"""Several cameras around the people in a simulated room: where they stand, what they are, their clocks.

Camera 0 stands at the origin of the room frame (y up, z along its view); the others stand around the people,
near walls where those are near, and look at the middle of their paths. Every camera has another kind of
sensor, another image, a rate and a first moment of its own, and a clock that runs a little off::

    stamp = true time + clock_offset + clock_drift * true time
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.rooms.rig import look_at
from depth_pose.sim.play import Cast, person_at
from depth_pose.sim.rooms import Room
from depth_pose.sim.scene_noise import FAMILIES, SceneSensor, sample_sensor
from depth_pose.sim.scene_view import View, draw
from depth_pose.sim.shapes import Triangles

Array = NDArray[np.float64]

FIRST_FPS = 15.0
"""Frame rate of camera 0."""
_OTHER_FPS = (12.5, 15.0, 30.0)
"""Frame rates of the other cameras, in random order."""
_MAX_DRIFT = 20e-6
"""Maximum drift of a clock against that of camera 0: common crystals are within 20 ppm."""
_FAR_M = (6.0, 10.0)
"""Range of the cameras' maximum distances, metres; as for a single camera in a room. Set by hand."""
_HEIGHTS_M = (1.0, 2.6)
"""Range of heights above the floor, metres. Set by hand."""
_AIMS_M = (0.7, 1.2)
"""Range of heights that cameras look at, metres. Set by hand."""
_AWAY_M = (2.3, 4.5)
"""Range of distances from the middle of the people's paths; walls may be nearer, metres. Set by hand."""
_FROM_WALL_M, _FROM_CEILING_M = 0.12, 0.1
"""Minimum distances of cameras from walls and ceiling, metres. Set by hand."""
_FROM_PEOPLE_M = 0.7
"""Minimum distance of people's paths from a camera, metres. Set by hand."""
_APART_DEG = 40.0
"""Minimum angle between two cameras, seen from the middle of the paths, degrees. Set by hand."""
_FIELDS_DEG = (55.0, 85.0)
"""Range of horizontal fields of view, degrees. Set by hand."""
_WIDTH_SHARES, _ASPECTS = (1.0, 0.9, 0.75), (4 / 3, 4 / 3, 16 / 9)
"""Widths relative to the given width, and width by height, of the cameras' images. Set by hand."""
_LOOK_EVERY_S = 2.0
"""Time between the moments at which a camera must see people, seconds. Set by hand."""
_SEES_SHARE = 0.6
"""Share of joints, over all moments, that a camera must see. Set by hand."""
_CLOSE_M, _CLOSE_SHARE = 0.8, 0.03
"""At most this share of an image may show things nearer than this, metres. Set by hand."""
_TRIES = 150
"""Maximum number of places tried for a camera; the best is kept where none suffices. Set by hand."""
_SMALL_PX = 80
"""Width of the images that places are judged by, pixels. Set by hand."""
_JOINT_SLACK_M = 0.25
"""A joint lies at most this far behind its own surface, metres."""


@dataclass(frozen=True)
class RoomCamera:
    """One camera of a simulated room.

    Attributes
    ----------
    view : View
        Intrinsics and pose.
    sensor : SceneSensor
    fps : float
        Frames a second of its own clock's true time.
    first : float
        True time of its first frame, seconds.
    clock_offset : float
        Its clock minus the true time, which is camera 0's clock, at time 0; seconds.
    clock_drift : float
        Growth of that difference, seconds per second.
    """

    view: View
    sensor: SceneSensor
    fps: float
    first: float = 0.0
    clock_offset: float = 0.0
    clock_drift: float = 0.0

    def times(self, seconds: float) -> Array:
        """Return the true times (N,) of its frames in a recording of this length, seconds."""
        return self.first + np.arange(max(1, round(seconds * self.fps))) / self.fps

    def stamps_ns(self, times: Array, start_ns: int) -> NDArray[np.int64]:
        """Return its stamps (N,) at true times after a start, nanoseconds."""
        shown = times + self.clock_offset + self.clock_drift * times
        return start_ns + np.rint(shown * 1e9).astype(np.int64)

    @property
    def T_camera_room(self) -> Array:
        """Transform (4, 4) from the room frame, y up, to the optical frame."""
        T = np.eye(4)
        T[:3, :3] = self.view.rotation
        T[:3, 3] = -self.view.rotation @ self.view.position
        return T


def place_cameras(
    rng: np.random.Generator,
    count: int,
    view: View,
    room: Room,
    surfaces: Triangles,
    cast: Cast,
    width: int,
    max_clock_offset: float,
) -> tuple[RoomCamera, ...]:
    """Place cameras around the people so that each sees them.

    Parameters
    ----------
    rng : numpy.random.Generator
    count : int
        Number of cameras, including camera 0.
    view : View
        Camera 0.
    room : Room
    surfaces : Triangles
        The furnished room.
    cast : sequence of (Performer, Track)
    width : int
        Maximum width of the images, pixels.
    max_clock_offset : float
        Maximum difference of a clock from that of camera 0, seconds.

    Returns
    -------
    tuple of RoomCamera
    """
    first = RoomCamera(view, _sensor(rng), FIRST_FPS)
    families = [str(f) for f in rng.permutation([f for f in FAMILIES if f != first.sensor.family])]
    families.append(first.sensor.family)
    rates = rng.permutation(_OTHER_FPS)
    judge = _Judge(room, surfaces, cast)
    cameras = [first]
    for i in range(count - 1):
        intrinsics = _sample_intrinsics(rng, width, i)
        fps = float(rates[i])
        placed = _find_place(rng, intrinsics, judge, [c.view for c in cameras])
        cameras.append(
            RoomCamera(
                placed,
                _sensor(rng, families[i]),
                fps,
                first=float(rng.uniform(0.0, 1.0 / fps)),
                clock_offset=float(rng.uniform(-max_clock_offset, max_clock_offset)),
                clock_drift=float(rng.uniform(-_MAX_DRIFT, _MAX_DRIFT)),
            )
        )
    return tuple(cameras)


def _sensor(rng: np.random.Generator, family: str | None = None) -> SceneSensor:
    return replace(sample_sensor(rng, family), far=rng.uniform(*_FAR_M))


def _sample_intrinsics(rng: np.random.Generator, width: int, i: int) -> Camera:
    wide = max(64, round(width * _WIDTH_SHARES[(i + 1) % 3]))
    tall = round(wide / float(rng.choice(_ASPECTS)))
    focal = wide / 2 / np.tan(np.deg2rad(rng.uniform(*_FIELDS_DEG)) / 2)
    cx, cy = (wide - 1) / 2 + rng.normal(0, 0.01 * wide), (tall - 1) / 2 + rng.normal(0, 0.01 * wide)
    return Camera(wide, tall, float(focal), float(focal * rng.normal(1, 0.003)), float(cx), float(cy))


def _find_place(rng: np.random.Generator, intrinsics: Camera, judge: _Judge, others: Sequence[View]) -> View:
    """Sample places until a camera sees the people from a new side; return the best after many tries."""
    best, most = others[0], -1.0
    for view in _places(rng, intrinsics, judge, others):
        sees = judge.share_seen(view)
        if sees > most:
            best, most = replace(view, camera=intrinsics), sees
        if sees >= _SEES_SHARE:
            break
    return best


def _places(
    rng: np.random.Generator, intrinsics: Camera, judge: _Judge, others: Sequence[View]
) -> Iterator[View]:
    """Yield places inside the room, off the people's paths, apart from the other cameras."""
    taken = [np.arctan2(*(v.position - judge.middle)[[0, 2]]) for v in others]
    apart = np.deg2rad(_APART_DEG)
    for k in range(_TRIES):
        azimuth = rng.uniform(-np.pi, np.pi)
        way = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
        spot = judge.middle + judge.reach(way, rng.uniform(*_AWAY_M)) * way
        top = min(_HEIGHTS_M[1], judge.room.walls.height - _FROM_CEILING_M)
        spot[1], aim = rng.uniform(_HEIGHTS_M[0], top), judge.middle.copy()
        aim[1], roll = rng.uniform(*_AIMS_M), rng.normal(0.0, np.deg2rad(2.0))
        narrow = apart * (1.0 - k / _TRIES)  # a small room may have less space
        if any(abs((azimuth - other + np.pi) % (2 * np.pi) - np.pi) < narrow for other in taken):
            continue
        if judge.is_free(spot):
            yield _looking(intrinsics, spot, aim, roll)


def _looking(camera: Camera, position: Array, target: Array, roll: float) -> View:
    c, s = np.cos(roll), np.sin(roll)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return View(camera, turn @ look_at(position, target)[:3, :3], position)


class _Judge:
    """Judges places for cameras by small images without noise."""

    def __init__(self, room: Room, surfaces: Triangles, cast: Cast) -> None:
        self.room, self._surfaces = room, surfaces
        self._spots = np.concatenate([track.spots for _, track in cast]) if cast else np.array([[0.0, 3.0]])
        middle = self._spots.mean(axis=0)
        self.middle = np.array([middle[0], 0.0, middle[1]])
        self._joints = np.concatenate(
            [
                person_at(p, track, t).joints
                for p, track in cast
                for t in range(0, len(track.spots), round(_LOOK_EVERY_S * p.fps))
            ]
            or [np.array([[middle[0], 1.0, middle[1]]])]
        )

    def reach(self, way: Array, wanted: float) -> float:
        """Return the distance from the middle to a wall in a direction, or the wanted one if less."""
        steps = np.arange(0.0, wanted, 0.05)
        free = [self.room.walls.inward(*(self.middle + step * way)[[0, 2]]) > _FROM_WALL_M for step in steps]
        return float(steps[np.flatnonzero(np.r_[free, False] == 0)[0] - 1]) if any(free) else 0.0

    def is_free(self, spot: Array) -> bool:
        """Whether nobody walks into a camera there."""
        return bool(np.linalg.norm(self._spots - spot[[0, 2]], axis=1).min() > _FROM_PEOPLE_M)

    def share_seen(self, view: View) -> float:
        """Return the share of all joints that the room does not hide; 0 for an obstructed camera."""
        c, scale = view.camera, _SMALL_PX / view.camera.width
        tall = round(c.height * scale)
        small = Camera(_SMALL_PX, tall, c.fx * scale, c.fy * scale, c.cx * scale, c.cy * scale)
        view = replace(view, camera=small)
        depth = draw(view.to_optical(self._surfaces.vertices), self._surfaces.faces, small).depth
        if np.mean((depth > 0) & (depth < _CLOSE_M)) > _CLOSE_SHARE:
            return 0.0
        joints = view.to_optical(self._joints)
        pixels = np.rint(np.nan_to_num(view.project(joints), nan=-1.0))
        inside = np.all((pixels >= 0) & (pixels < [_SMALL_PX, tall]), axis=1)
        u, v = pixels[inside].astype(np.int64).T
        shown = (depth[v, u] <= 0) | (depth[v, u] > joints[inside, 2] - _JOINT_SLACK_M)
        return float(shown.sum() / len(joints))
