"""The floor that people stand on, from their skeletons and, where it is given, the depth recording.

Feet say roughly where the floor is: a toe base lies .044 of the stature above it (`rest_nodes`), and a
trunk that stands says which way is up. The depth images then say it exactly: points near that plane
are fitted by least squares, with a tolerance that shrinks to that of `depth_pose.people.planes`.

The world is REP-103's: x forward (where the sensor looks), y to the left, z up, the origin on the floor
below the sensor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import ADULT_STATURE_M, JOINT_INDEX, rest_nodes
from depth_pose.core.types import DepthFrame
from depth_pose.export.tracks import Track

Array = NDArray[np.float64]

_SURE = 0.5
_STANDING_COS = np.cos(np.radians(25.0))
"""Trunk and shanks within this angle of each other: the person stands. Set by hand."""
_FEET_SPREAD_M = 0.04
"""How far toe bases lie from where feet on the floor have them: joint error and lifted feet. Set by hand,
of the size of the feet's error in `docs/accuracy.md`."""
_UP_SPREAD = 0.07
"""How far a standing trunk leans on average over a recording, radians (4 degrees). Set by hand."""
_ROUNDS = 8
_FRAMES = 12
_POINTS_A_FRAME = 20_000
_LEAST_POINTS = 2_000
"""Of all frames' points, so many must lie on the floor; it is 1 % of those looked at."""
_LEVEL_COS = np.cos(np.radians(40.0))
"""Surfaces tilted more than this against the guess are not floor; noise tilts patches of it. Set by hand."""
_FIRST_TOLERANCE, _LAST_TOLERANCE = 0.12, 0.012
"""Distance from the plane as a share of the range. The first allows for feet's guess: 5 degrees and 10 cm
at 3 m; the last is that of `depth_pose.people.planes`."""


@dataclass(frozen=True)
class Floor:
    """A floor in the camera frame: points x on it have ``normal @ x + height = 0``.

    Attributes
    ----------
    normal : (3,) float64
        Up, unit length.
    height : float
        Of the camera above it, metres.
    source : str
        What it was found from.
    """

    normal: Array
    height: float
    source: str

    def T_world_camera(self) -> Array:
        """Transform from the camera to the world on the floor, (4, 4)."""
        forward = np.array([0.0, 0.0, 1.0])
        if abs(self.normal[2]) > np.cos(np.radians(10.0)):  # straight down: forward is the image's up
            forward = np.array([0.0, -1.0, 0.0])
        x = forward - (forward @ self.normal) * self.normal
        x /= np.linalg.norm(x)
        out = np.eye(4)
        out[:3, :3] = np.stack([x, np.cross(self.normal, x), self.normal])
        out[2, 3] = self.height
        return out


def floor_of_feet(tracks: Iterable[Track]) -> Floor:
    """Find the floor from where people's feet are.

    Raises
    ------
    InputError
        Where nobody's feet and trunk are known well enough.
    """
    tracks = [track for track in tracks if track.present.any()]
    up = _up(tracks)
    toes = [_toes(track, up) for track in tracks]
    points = np.concatenate([p for p, _ in toes]) if toes else np.zeros((0, 3))
    if len(points) < 2:
        raise InputError("nobody's feet are seen well enough to tell the floor")
    below = np.concatenate([h for _, h in toes])
    return _settled(points - below[:, None] * up, up)


def _up(tracks: list[Track]) -> Array:
    """Mean direction of trunks that stand, else of all trunks, camera frame."""
    standing, trunks = [], []
    for track in tracks:
        at = {name: track.positions[track.present, i] for name, i in JOINT_INDEX.items()}
        trunk = _unit(at["neck"] - at["pelvis"])
        shanks = [np.sum(trunk * _unit(at[f"{s}_hip"] - at[f"{s}_ankle"]), axis=1) for s in ("left", "right")]
        trunks.append(trunk)
        standing.append(trunk[np.min(shanks, axis=0) > _STANDING_COS])
    for some in (standing, trunks):
        found = np.concatenate(some) if some else np.zeros((0, 3))
        if len(found):
            return np.asarray(_unit(np.median(found, axis=0)))
    raise InputError("the recording has no skeletons to tell the floor from")


def _toes(track: Track, up: Array) -> tuple[Array, Array]:
    """Toe bases that are lowest of the body, and how high they should lie above the floor, metres."""
    share = rest_nodes()[-1, 1]
    feet = [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]]
    there = np.flatnonzero(track.present)
    heights = track.positions[there][:, feet] @ up
    lower = np.argmin(heights, axis=1)
    points = track.positions[there, np.array(feet)[lower]]
    sure = track.joint_confidence[there, np.array(feet)[lower]] >= _SURE
    size = np.where(track.scale[there] > 0, track.scale[there], 1.0)
    return points[sure], (share * ADULT_STATURE_M * size)[sure].astype(np.float64)


def _settled(points: Array, up: Array) -> Floor:
    """Fit a plane to points on the floor, pulled to a direction of up; jumps count little."""
    forward = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 0.9 else np.array([0.0, -1.0, 0.0])
    first = _unit(forward - (forward @ up) * up)
    second = np.cross(up, first)
    middle = points.mean(axis=0)
    flat = np.stack([(points - middle) @ first, (points - middle) @ second, np.ones(len(points))], axis=1)
    above = (points - middle) @ up
    prior = np.diag([1.0, 1.0, 0.0]) * (_FEET_SPREAD_M / _UP_SPREAD) ** 2
    slope = np.array([0.0, 0.0, np.percentile(above, 25)])  # lifted feet are above it, none below
    for _ in range(_ROUNDS):
        weight = 1.0 / (1.0 + ((above - flat @ slope) / _FEET_SPREAD_M) ** 2) ** 2
        normal_matrix = flat.T @ (weight[:, None] * flat) + prior
        slope = np.linalg.solve(normal_matrix, flat.T @ (weight * above))
    normal = _unit(up - slope[0] * first - slope[1] * second)
    on_it = middle + slope[2] * up
    return Floor(np.asarray(normal), float(-normal @ on_it), "feet")


def floor_of_depth(frames: Iterable[DepthFrame], guess: Floor) -> Floor | None:
    """Find the floor in depth images, near a guess; None where too little of it is seen.

    Parameters
    ----------
    frames : iterable of DepthFrame
        A dozen, spread over the recording, are enough; see `some_frames`.
    guess : Floor
    """
    points = np.concatenate([_level_points(frame, guess.normal) for frame in frames] or [np.zeros((0, 3))])
    normal, height = guess.normal, guess.height
    for tolerance in np.geomspace(_FIRST_TOLERANCE, _LAST_TOLERANCE, _ROUNDS):
        near = np.abs(points @ normal + height) < tolerance * np.linalg.norm(points, axis=1)
        if near.sum() < _LEAST_POINTS:
            return None
        weights = 1.0 / np.linalg.norm(points[near], axis=1)  # noise goes with the range
        middle = np.average(points[near], axis=0, weights=weights**2)
        spread = (points[near] - middle) * weights[:, None]
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        normal = normal if normal @ guess.normal > 0 else -normal
        height = float(-normal @ middle)
    if normal @ guess.normal < np.cos(np.radians(20.0)):
        return None
    return Floor(np.asarray(normal), height, "depth images")


def some_frames(frames: Iterable[DepthFrame], count: int) -> list[DepthFrame]:
    """Take a dozen frames, spread over a recording of so many."""
    step = max(1, count // _FRAMES)
    return [frame for i, frame in enumerate(frames) if i % step == 0][:_FRAMES]


def _level_points(frame: DepthFrame, up: Array) -> Array:
    """Points of surfaces that lie about level, evenly thinned; walls and legs would pull at their corners."""
    from scipy.ndimage import uniform_filter

    reach = max(2, frame.depth.shape[0] // 72)
    known = np.isfinite(frame.depth) & (frame.depth > 0)
    points = frame.camera.back_project(frame.depth).astype(np.float64)
    share = uniform_filter(known.astype(np.float64), 2 * reach + 1)
    smooth = uniform_filter(np.where(known[..., None], points, 0.0), (2 * reach + 1, 2 * reach + 1, 1))
    smooth /= np.maximum(share, 1e-9)[..., None]
    normals = np.zeros_like(smooth)
    down = smooth[2 * reach :, reach:-reach] - smooth[: -2 * reach, reach:-reach]
    right = smooth[reach:-reach, 2 * reach :] - smooth[reach:-reach, : -2 * reach]
    normals[reach:-reach, reach:-reach] = _unit(np.cross(right, down))
    level = known & (np.abs(normals @ up) > _LEVEL_COS)
    rows, columns = np.nonzero(level)
    step = max(1, len(rows) // _POINTS_A_FRAME)
    return np.asarray(points[rows[::step], columns[::step]])


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))
