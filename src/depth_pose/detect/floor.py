"""The floor: the lowest large plane below the sensor that is more level than upright."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.detect.planes import PlaneFinder
from depth_pose.detect.working_grid import reduce_frame

Array = NDArray[np.float64]

_TILT_DEG = 60.0
"""Maximum angle (degrees) of the floor's normal from the expected upward direction; steeper planes are
walls."""

_FACING_DEG = 35.0
"""Maximum angle (degrees) between the viewing direction and the normal of a floor known only from people."""

_NEAR_M, _TALL_M = 0.3, 0.9
"""Maximum height of a standing person's lowest point above the plane, as the image may cut off the feet, and
minimum height of the highest point (m). Half and double answer the same in rooms."""

LEVEL_UP = np.array([0.0, -1.0, 0.0])
"""Up as a level sensor sees it, camera frame."""

_STRAIGHT = np.cos(np.radians(10.0))
"""Least cosine between the optical axis and the vertical of a sensor that looks straight down."""

_LEAST_HEIGHT_M = 0.15
"""Least height (m) of the sensor; a nearer plane is its support. Half and double answer the same in rooms."""

_BANDS_M = (0.04, 0.03, 0.02, 0.02)
"""Half the layer thickness (m) of each fitting round: above sensor noise at 4 m, below the height of a
foot."""

_LEAST_POINTS = 100
"""Least number of points for refitting a plane."""

_MOST_POINTS = 6000
"""Approximate number of points used per frame."""

BY_PEOPLE = "people who stand on it"
"""Source of a floor that a sensor with unknown mounting sees before it."""

_TURNED_DEG, _MOVED_M = 1.0, 0.03
"""Maximum change of the known floor's direction (degrees) and height (m), above noise. Half and double
answer the same in rooms."""


@dataclass(frozen=True)
class Floor:
    """The floor's plane.

    Attributes
    ----------
    up : (3,) float64
        Unit normal toward the sensor, camera frame.
    height : float
        Height of the sensor above the floor, metres.
    source : str
        Source of the estimate.
    deviation : float
        Standard deviation of the floor's height under the people, metres; that of depth images is measured on
        simulated rooms, as the next.
    tilt_deviation_deg : float
        Standard deviation of ``up``, degrees.
    """

    up: Array
    height: float
    source: str = "depth images"
    deviation: float = 0.01
    tilt_deviation_deg: float = 0.5

    @property
    def plane(self) -> Array:
        """Normal, upward, and height, (4,)."""
        return np.array([*self.up, self.height])

    @property
    def T_camera_floor(self) -> Array:
        """Transform from the floor frame (below the sensor, z up, x forward, y left), shape (4, 4)."""
        look = np.array([0.0, 0.0, 1.0])
        if abs(self.up[2]) > _STRAIGHT:  # looking down or up: forward is the image's upper border
            look = np.array([0.0, -1.0, 0.0])
        ahead = look - (look @ self.up) * self.up
        ahead /= np.linalg.norm(ahead)
        T = np.eye(4)
        T[:3, :3] = np.stack([ahead, np.cross(self.up, ahead), self.up], axis=1)
        T[:3, 3] = -self.height * self.up
        return T

    @property
    def T_floor_camera(self) -> Array:
        """Transform from the camera frame to the floor frame, (4, 4)."""
        return np.asarray(np.linalg.inv(self.T_camera_floor))

    def is_like(self, other: Floor, factor: float = 1.0) -> bool:
        """Check that another floor is the same up to noise, or to a multiple of it."""
        turned = np.degrees(np.arccos(np.clip(self.up @ other.up, -1.0, 1.0)))
        return bool(turned < factor * _TURNED_DEG and abs(self.height - other.height) < factor * _MOVED_M)

    def turned(self, rotation: Array) -> Floor:
        """Return the floor in a rotated frame: ``rotation`` (3, 3) maps vectors to it."""
        return replace(self, up=rotation @ self.up)

    def to_metadata(self) -> dict[str, str]:
        """Return the plane as a metadata record of a recording holds it; see `from_metadata`."""
        return {"up": " ".join(repr(float(v)) for v in self.up), "height": repr(float(self.height))}

    @classmethod
    def from_metadata(cls, values: Mapping[str, str]) -> Floor | None:
        """Return the floor of a metadata record; None if that does not hold one."""
        try:
            up, height = np.array([float(v) for v in values["up"].split()]), float(values["height"])
        except (KeyError, ValueError):
            return None
        is_plane = up.shape == (3,) and abs(np.linalg.norm(up) - 1.0) < 1e-6 and np.isfinite(height)
        return cls(up, height) if is_plane else None


def stands_on(points: NDArray[np.floating], floor: Floor) -> bool:
    """Check whether a person's points (N, 3), camera frame, begin at a floor and reach far from it."""
    low, high = np.percentile(points @ floor.up + floor.height, [2.0, 98.0])
    return bool(abs(low) < _NEAR_M and high > _TALL_M)


class FloorFinder:
    """Finds the floor, and keeps it while it does not move.

    Parameters
    ----------
    config : SegmentConfig
        Settings of the working grid.
    up : (3,) float64
        Approximate direction of up, camera frame: from the mounting, an IMU or a transform.

    Attributes
    ----------
    floor : Floor or None
        The known floor.
    up : (3,) float64
        As the parameter; may be set at any time.
    """

    def __init__(self, config: SegmentConfig, up: Array = LEVEL_UP) -> None:
        self._config = config
        self.up = up
        self.reset()

    def reset(self) -> None:
        """Forget the floor."""
        self.floor: Floor | None = None
        self._new: Floor | None = None
        self._planes = PlaneFinder()

    def update(self, frame: DepthFrame, people: Sequence[NDArray[np.floating]] = ()) -> bool:
        """Search a frame for the floor; return whether `floor` has changed.

        A different floor, and one known only from people, must be seen in two consecutive searches, so that
        people who walk past do not move it.
        """
        seen = self.find(frame, people)
        if seen is None or (self.floor is not None and seen.is_like(self.floor)):
            self._new = None
            return False
        doubtful = self.floor is not None or seen.source == BY_PEOPLE
        if doubtful and (self._new is None or not seen.is_like(self._new)):
            self._new = seen
            return False
        self.floor, self._new = seen, None
        return True

    def find(self, frame: DepthFrame, people: Sequence[NDArray[np.floating]] = ()) -> Floor | None:
        """Find the floor in one frame; None if it is not visible.

        Parameters
        ----------
        frame : DepthFrame
            Planes seen before are tried first.
        people : sequence of (N, 3) arrays
            Points of all people, camera frame, metres. A plane in front of a sensor that may look straight
            down is the floor if a person stands on it.
        """
        depth, camera = reduce_frame(frame, self._config)
        points = camera.back_project(depth)
        floors, before = [], []
        for plane in self._planes.find(points, camera):
            up, height = (-plane[:3], float(plane[3])) if plane[3] > 0.0 else (plane[:3], float(-plane[3]))
            if height <= _LEAST_HEIGHT_M:
                continue
            if up @ self.up > np.cos(np.radians(_TILT_DEG)):
                floors.append(Floor(up, height))
            elif -up[2] > np.cos(np.radians(_FACING_DEG)):
                before.append(Floor(up, height, BY_PEOPLE))
        if not floors:
            floors = [floor for floor in before if any(stands_on(p, floor) for p in people)]
        if not floors:
            return None
        return _fit(points[depth > 0.0], max(floors, key=lambda floor: floor.height))


def _fit(points: NDArray[np.float32], floor: Floor) -> Floor:
    """Refit the plane to all points (N, 3) close to it, with a shrinking tolerance.

    The sensor's height is extrapolated from floor points that may be metres away. The few samples of
    `PlaneFinder` may tilt the plane by half a degree, which is 4 cm of height there.
    """
    points = points[:: max(1, len(points) // _MOST_POINTS)]
    for band_m in _BANDS_M:
        near = points[np.abs(points @ floor.up + floor.height) < band_m].astype(np.float64)
        if len(near) < _LEAST_POINTS:
            break
        middle = near.mean(axis=0)
        up = np.linalg.eigh((near - middle).T @ (near - middle))[1][:, 0]
        up = -up if up @ floor.up < 0.0 else up
        floor = replace(floor, up=up, height=float(-up @ middle))
    return floor
