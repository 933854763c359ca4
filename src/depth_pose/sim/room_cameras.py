"""Several cameras around the people in a simulated room: their poses, sensors and clocks.

Camera 0 stands at the origin of the room frame (y up, z along its view); the others stand around the people,
near walls where those are near, and look at the middle of their paths. Every camera has its own kind of
sensor, image size, frame rate and start time, and a clock with an error::

    stamp = true time + clock_offset + clock_drift * true time

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.sim.play import Cast
from depth_pose.sim.room_places import Places
from depth_pose.sim.rooms import Room
from depth_pose.sim.scene_noise import FAMILIES, SceneSensor, sample_sensor
from depth_pose.sim.scene_view import View
from depth_pose.sim.shapes import Triangles

Array = NDArray[np.float64]

FIRST_FPS = 15.0
"""Frame rate of camera 0."""
_OTHER_FPS = (12.5, 15.0, 30.0)
"""Frame rates of the other cameras, in random order."""
_MAX_DRIFT = 20e-6
"""Maximum drift of a clock against that of camera 0: common crystals are within 20 ppm."""
_FAR_M = (6.0, 10.0)
"""Range of the cameras' maximum distances, metres; as for a single camera in a room."""
_FIELDS_DEG = (55.0, 85.0)
"""Range of horizontal fields of view, degrees."""
_WIDTH_SHARES, _ASPECTS = (1.0, 0.9, 0.75), (4 / 3, 4 / 3, 16 / 9)
"""Widths relative to the given width, and width by height, of the cameras' images."""


@dataclass(frozen=True)
class RoomCamera:
    """One camera of a simulated room.

    Attributes
    ----------
    view : View
        Intrinsics and pose.
    sensor : SceneSensor
    fps : float
        Frames a second.
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
    places = Places(room, surfaces, cast)
    cameras = [first]
    for i in range(count - 1):
        intrinsics = _sample_intrinsics(rng, width, i)
        fps = float(rates[i])
        placed = places.find(rng, intrinsics, [c.view for c in cameras])
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
