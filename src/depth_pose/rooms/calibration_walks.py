"""Tracks of people over the floor: positions and facing directions of a levelled camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.rooms.calibration_input import BodyTrack

Array = NDArray[np.float64]

_TRUNK = [JOINT_INDEX[n] for n in ("pelvis", "spine", "chest", "neck")]
_LEFT = [JOINT_INDEX["left_shoulder"], JOINT_INDEX["left_hip"]]
_RIGHT = [JOINT_INDEX["right_shoulder"], JOINT_INDEX["right_hip"]]
_RATE_HZ = 5.0
"""Number of a track's moments compared per second. Set by hand."""
_MOST_GAP_S = 0.6
"""Maximum time between two moments for interpolation (s). Set by hand."""
_LEAST_FRAMES, _LEAST_S = 3, 0.5
"""Minimum length of a compared track: frames, seconds. Set by hand."""


@dataclass(frozen=True)
class Walk:
    """A levelled track: positions and facing directions on the floor.

    Attributes
    ----------
    times : (N,) float64
        Seconds.
    places : (N, 2) float64
        x and y of the trunk, the camera's floor frame (z up), metres.
    sides : (N, 2) float64
        From the right side to the left, length 1.
    seconds : (N,) float64
        Time represented by each moment.
    """

    times: Array
    places: Array
    sides: Array
    seconds: Array

    def at(self, times: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Interpolate positions and sides at times (M,); also return whether the walk covers them."""
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        gap = np.maximum(self.times[after] - self.times[after - 1], 1e-6)
        share = (times - self.times[after - 1]) / gap
        covered = (share >= 0.0) & (share <= 1.0) & (gap <= _MOST_GAP_S)
        share = np.clip(share, 0.0, 1.0)[:, None]
        places = (1.0 - share) * self.places[after - 1] + share * self.places[after]
        sides = (1.0 - share) * self.sides[after - 1] + share * self.sides[after]
        return places, sides, covered

    def mirrored(self) -> Walk:
        """Return the mirrored walk; a body's left becomes its right, as a tracker would label it."""
        flip = np.array([1.0, -1.0])
        return Walk(self.times, self.places * flip, -self.sides * flip, self.seconds)


def level_walk(track: BodyTrack, T_floor_camera: Array) -> Walk | None:
    """Return a track's positions and facing directions on the floor; None if it is too short."""
    if len(track.times) < _LEAST_FRAMES or track.times[-1] - track.times[0] < _LEAST_S:
        return None
    step = max(1, int(np.floor(1.0 / (_RATE_HZ * max(float(np.median(np.diff(track.times))), 1e-3)))))
    kept = slice(None, None, step)
    flat = (track.joints[kept] @ T_floor_camera[:3, :3].T + T_floor_camera[:3, 3])[..., :2]
    sides = flat[:, _LEFT].mean(axis=1) - flat[:, _RIGHT].mean(axis=1)
    sides /= np.maximum(np.linalg.norm(sides, axis=1, keepdims=True), 1e-6)
    times = track.times[kept]
    seconds = np.minimum(np.gradient(times), _MOST_GAP_S) if len(times) > 1 else np.zeros(len(times))
    return Walk(times, flat[:, _TRUNK].mean(axis=1), sides, seconds)
