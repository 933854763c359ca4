"""The floor: the lowest large plane below the sensor that is more level than upright."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.types import DepthFrame
from depth_pose.detect.planes import PlaneFinder
from depth_pose.detect.working_grid import reduce_frame

Array = NDArray[np.float64]

_TILT_DEG = 60.0
"""Farther than this off the image's upward direction a plane is a wall. A sensor may so look down by this
much; of one that looks straight down the image does not say where up is."""

_STRAIGHT = np.cos(np.radians(10.0))
"""Of the angle between the axis of a sensor that looks straight down and the vertical."""

_LEAST_HEIGHT_M = 0.15
"""Nearer below the sensor than this lies what it stands on; set by hand."""

_BANDS_M = (0.04, 0.03, 0.02, 0.02)
"""Half the thickness of the layer that the floor is fitted to, round by round: wider than a sensor's noise at
4 m, thinner than a foot. In a simulated room seen from .9 m up the height came out 2 cm off instead of 4."""

_LEAST_POINTS = 100
"""With fewer points than this the plane stays as it was found."""

_MOST_POINTS = 6000
"""About so many points of a frame are taken."""

_TURNED_DEG, _MOVED_M = 1.0, 0.03
"""A floor that differs by more than this from the one known is another; by hand, above what noise does
(docs/topics.md)."""


@dataclass(frozen=True)
class Floor:
    """The floor's plane.

    Attributes
    ----------
    up : (3,) float64
        Unit normal, towards the sensor, camera frame.
    height : float
        Of the sensor above it, metres.
    source : str
        What it was found from.
    """

    up: Array
    height: float
    source: str = "depth images"

    @property
    def T_camera_floor(self) -> Array:
        """Frame on the floor straight below the sensor: z up, x where it looks, y to its left; (4, 4)."""
        look = np.array([0.0, 0.0, 1.0])
        if abs(self.up[2]) > _STRAIGHT:  # down, or up: ahead is the image's upper border
            look = np.array([0.0, -1.0, 0.0])
        ahead = look - (look @ self.up) * self.up
        ahead /= np.linalg.norm(ahead)
        T = np.eye(4)
        T[:3, :3] = np.stack([ahead, np.cross(self.up, ahead), self.up], axis=1)
        T[:3, 3] = -self.height * self.up
        return T

    @property
    def T_floor_camera(self) -> Array:
        """From the camera's frame to that on the floor, (4, 4)."""
        return np.asarray(np.linalg.inv(self.T_camera_floor))

    def is_like(self, other: Floor) -> bool:
        """Whether it is the same floor, but for noise."""
        turned = np.degrees(np.arccos(np.clip(self.up @ other.up, -1.0, 1.0)))
        return bool(turned < _TURNED_DEG and abs(self.height - other.height) < _MOVED_M)

    def turned(self, rotation: Array) -> Floor:
        """Give the same floor in a frame that is turned: ``rotation`` (3, 3) takes vectors there."""
        return Floor(rotation @ self.up, self.height, self.source)


class FloorFinder:
    """Finds the floor, and keeps it while it stays where it is.

    Attributes
    ----------
    floor : Floor or None
        The one that is known.
    """

    def __init__(self, config: SegmentConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget the floor."""
        self.floor: Floor | None = None
        self._new: Floor | None = None
        self._planes = PlaneFinder()

    def update(self, frame: DepthFrame) -> bool:
        """Look for the floor in a frame; gives whether `floor` has changed.

        Another floor counts once it is seen twice in turn, so that nobody who walks past moves it.
        """
        seen = self.find(frame)
        if seen is None or (self.floor is not None and seen.is_like(self.floor)):
            self._new = None
            return False
        if self.floor is not None and (self._new is None or not seen.is_like(self._new)):
            self._new = seen
            return False
        self.floor, self._new = seen, None
        return True

    def find(self, frame: DepthFrame) -> Floor | None:
        """Find the floor in one frame; None where none is seen.

        Parameters
        ----------
        frame : DepthFrame
            Its image's upper border is up, roughly. Planes seen before are tried first.
        """
        depth, camera = reduce_frame(frame, self._config)
        points = camera.back_project(depth)
        floors = []
        for plane in self._planes.find(points, camera):
            up, height = (-plane[:3], float(plane[3])) if plane[3] > 0.0 else (plane[:3], float(-plane[3]))
            if -up[1] > np.cos(np.radians(_TILT_DEG)) and height > _LEAST_HEIGHT_M:
                floors.append(Floor(up, height))
        if not floors:
            return None
        return _fit(points[depth > 0.0], max(floors, key=lambda floor: floor.height))


def _fit(points: NDArray[np.float32], floor: Floor) -> Floor:
    """Fit the plane again to all points (N, 3) that lie close to it, ever closer.

    The height is that below the sensor, often metres before the first floor that is seen: half a degree, by
    which the few samples of `PlaneFinder` may be off, is 4 cm there.
    """
    points = points[:: max(1, len(points) // _MOST_POINTS)]
    for band_m in _BANDS_M:
        near = points[np.abs(points @ floor.up + floor.height) < band_m].astype(np.float64)
        if len(near) < _LEAST_POINTS:
            break
        middle = near.mean(axis=0)
        up = np.linalg.eigh((near - middle).T @ (near - middle))[1][:, 0]
        up = -up if up @ floor.up < 0.0 else up
        floor = Floor(up, float(-up @ middle))
    return floor
