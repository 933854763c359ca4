"""Large planes of a room, which are not the person: walls, floor and ceiling."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.detect import _plane_kernels as kernels

WALL_AREA_M2, WALL_WIDTH_M = 1.5, 0.2
"""Least visible area of a plane (m^2), and least standard deviation (m) along its narrower side; a
person's back has less."""

FLOOR_AREA_M2, FLOOR_WIDTH_M = 0.6, 0.12
"""The same for planes less than 40 degrees off the camera's horizontal, where no back is."""

_TOLERANCE = 0.012
"""Maximum distance of a point from its plane, as a share of the range."""

_WINDOW = 3
"""Pixels around a marked one, to each side, half of which must lie on its plane. Half loses .009 of the
joints within 10 cm in rooms, double .004."""

_MAX_PLANES = 10
"""Maximum number of planes in a room. Half loses .004 of the joints within 10 cm, double changes nothing."""
_SEEDS = 64
"""Number of candidate planes, each through one point, for each plane. Half loses .008, double is the same."""
_SAMPLES = 2500
"""Approximate number of image points searched for planes. Half loses .004, double .007."""
_SEARCH_EVERY = 15
"""Frames between searches for new planes."""
_ROUNDS, _FEWEST = 4, 10
"""Maximum number of times that one plane is fitted, and minimum number of samples for a fit."""
_LEVEL = math.cos(math.radians(40.0))
"""Least vertical component of the normal of a floor or ceiling, whose least area is `FLOOR_AREA_M2`."""

Array = NDArray[np.float64]


class PlaneFinder:
    """Marks large planes; those of the previous frame are tried first, since cameras rarely move."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the room."""
        self._known: list[Array] = []
        self._frames = 0

    def find(self, points: NDArray[np.float32], camera: Camera) -> list[Array]:
        """Find large planes.

        Parameters
        ----------
        points, camera
            As in `mark`.

        Returns
        -------
        list of (4,) float64
            Unit normal n and offset d of each plane, ``n . p = d``, camera frame, metres.
        """
        room = _Samples.draw(points, camera)
        found = [plane for known in self._known if (plane := room.take(known)) is not None]
        if len(found) < len(self._known) or self._frames % _SEARCH_EVERY == 0:
            found += _search(room, _MAX_PLANES - len(found))
        self._known = found
        self._frames += 1
        return found

    def mark(self, points: NDArray[np.float32], camera: Camera) -> NDArray[np.bool_]:
        """Mark the pixels of large planes.

        Parameters
        ----------
        points : (h, w, 3) float32
            Organised points, metres, NaN without depth.
        camera : Camera
            Camera of the grid.

        Returns
        -------
        (h, w) bool
        """
        planes = np.array(self.find(points, camera)).reshape(-1, 4)
        marked = np.zeros(points.shape[:2], np.bool_)
        kernels.mark_planes(points, planes, 1.5 * _TOLERANCE, _WINDOW, marked)
        return marked


class _Samples:
    """Samples of a frame's surfaces that no plane explains yet."""

    def __init__(self, points: Array, normals: Array, areas: Array) -> None:
        self.points, self.normals, self.areas = points, normals, areas

    @classmethod
    def draw(cls, points: NDArray[np.float32], camera: Camera) -> _Samples:
        return cls(*kernels.draw_samples(points, _SAMPLES, max(2, points.shape[0] // 36), camera.fx))

    def take(self, guess: Array) -> Array | None:
        """Fit a plane to the samples near it and remove those; None if there is none, or it is small."""
        plane, inliers = guess.copy(), np.zeros(len(self.points), np.bool_)
        area, width = kernels.fit_plane(
            self.points, self.normals, self.areas, plane, _TOLERANCE, _ROUNDS, _FEWEST, inliers
        )
        is_plane = _is_large(plane, area, width)
        if is_plane:  # its noisy points must not form another plane
            kernels.add_near(self.points, plane, 2.5 * _TOLERANCE, inliers)
        count = kernels.remove(self.points, self.normals, self.areas, inliers)
        self.points, self.normals, self.areas = self.points[:count], self.normals[:count], self.areas[:count]
        return plane if is_plane else None


def _search(room: _Samples, most: int) -> list[Array]:
    """Find planes among the samples, the largest first."""
    rng = np.random.default_rng(0)  # the same frame always gives the same planes
    found = []
    for _ in range(most):
        if room.areas.sum() < FLOOR_AREA_M2:
            break
        seeds = rng.integers(0, len(room.points), _SEEDS)
        guess = kernels.best_plane(room.points, room.normals, room.areas, seeds, _TOLERANCE)
        if (plane := room.take(guess)) is not None:
            found.append(plane)
    return found


def _is_large(plane: Array, area: float, width: float) -> bool:
    if abs(plane[1]) > _LEVEL:
        return area >= FLOOR_AREA_M2 and width >= FLOOR_WIDTH_M
    return area >= WALL_AREA_M2 and width >= WALL_WIDTH_M
