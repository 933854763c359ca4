"""Observations of one camera, people over time and the empty room: the input of a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JointState
from depth_pose.rooms.background import EmptyRoom

Array = NDArray[np.float64]

MOST_GAP_S = 0.45
"""Maximum time between two frames for interpolation (s). Set by hand."""

_SMOOTH_S, _MOST_NEIGHBOURS = 0.08, 6
"""Standard deviation (s) of a track's smoothing weights over time, and the number of neighbours on either
side. Set by hand."""


@dataclass(frozen=True)
class Moments:
    """One track at given times: joints (N, 19, 3) and their velocities, camera frame, m and m/s.

    ``confidence`` (N, 19) is 0 for joints that were not seen, and for all joints where ``present`` (N,) is
    False: the track has no frames near that time.
    """

    joints: Array
    velocities: Array
    confidence: Array
    present: NDArray[np.bool_]


@dataclass(frozen=True)
class BodyTrack:
    """One person in one camera, from detection to loss.

    Attributes
    ----------
    times : (N,) float64
        Stamps, seconds since the calibration's reference time, ascending.
    joints, velocities : (N, 19, 3) float64
        Smoothed over time; camera frame, metres and m/s.
    confidence : (N, 19) float64
        0 for joints that were not seen.
    """

    times: Array
    joints: Array
    velocities: Array
    confidence: Array

    @cached_property
    def seconds(self) -> Array:
        """Time represented by each frame, (N,), seconds."""
        if len(self.times) < 2:
            return np.zeros(len(self.times))
        return np.minimum(np.gradient(self.times), MOST_GAP_S)

    def at(self, times: Array) -> Moments:
        """Interpolate the track at times (M,)."""
        if len(self.times) < 2:
            shape = (len(times), *self.joints.shape[1:])
            empty = np.zeros(len(times), bool)
            return Moments(np.zeros(shape), np.zeros(shape), np.zeros(shape[:2]), empty)
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        before = after - 1
        gap = np.maximum(self.times[after] - self.times[before], 1e-6)
        share = (times - self.times[before]) / gap
        present = (share >= 0.0) & (share <= 1.0) & (gap <= MOST_GAP_S)
        share = np.clip(share, 0.0, 1.0)[:, None, None]
        joints = (1.0 - share) * self.joints[before] + share * self.joints[after]
        velocities = (1.0 - share) * self.velocities[before] + share * self.velocities[after]
        confidence = np.minimum(self.confidence[before], self.confidence[after]) * present[:, None]
        return Moments(joints, velocities, confidence, present)


@dataclass
class CameraRecord:
    """Data of one camera for a calibration; it grows frame by frame.

    Attributes
    ----------
    name : str
    camera : Camera or None
        None until it is known.
    frame_id : str
        Name of its optical frame.
    topic : str
        The topic of its depth images.
    stamps_ns : list of int
        Of all frames, also of those without people.
    background : EmptyRoom or None
        The empty room, if it is known.
    upside_down : str
        Why the images look upside down; empty where they do not.
    """

    name: str
    camera: Camera | None = None
    frame_id: str = ""
    topic: str = ""
    stamps_ns: list[int] = field(default_factory=list)
    background: EmptyRoom | None = None
    upside_down: str = ""
    _bodies: dict[str, list[Skeleton]] = field(default_factory=dict)

    def add(self, stamp_ns: int, skeletons: Sequence[Skeleton]) -> None:
        """Add the people of a frame; a frame that is not later than the last one is ignored."""
        if self.stamps_ns and stamp_ns <= self.stamps_ns[-1]:
            return
        self.stamps_ns.append(stamp_ns)
        for skeleton in skeletons:
            if not skeleton.is_lost:
                self._bodies.setdefault(skeleton.body_id, []).append(skeleton)

    def tracks(self, reference_ns: int) -> tuple[BodyTrack, ...]:
        """Return the tracks; their times count from ``reference_ns``."""
        return tuple(_track_of(skeletons, reference_ns) for skeletons in self._bodies.values())


def _track_of(skeletons: Sequence[Skeleton], reference_ns: int) -> BodyTrack:
    confidence = np.stack([s.joint_confidence for s in skeletons]).astype(np.float64)
    states = np.stack([s.joint_states for s in skeletons])
    confidence = np.where(states == JointState.SEEN, confidence, 0.0)
    times = np.array([(s.stamp_ns - reference_ns) * 1e-9 for s in skeletons])
    joints, velocities = smooth_joints(times, np.stack([s.positions for s in skeletons]), confidence)
    return BodyTrack(times, joints, velocities, confidence)


def smooth_joints(times: Array, joints: Array, confidence: Array) -> tuple[Array, Array]:
    """Fit a line through each joint's neighbours in time; return positions and velocities.

    Without smoothing, interpolation averages noise, which favours clock offsets that interleave the two
    cameras' frames.

    Parameters
    ----------
    times : (N,) float64
        Seconds, ascending.
    joints : (N, J, 3) float64
    confidence : (N, J) float64
    """
    sums = np.zeros((3, *confidence.shape))
    moments = np.zeros((2, *joints.shape))
    number = np.arange(len(times))
    for k in range(-_MOST_NEIGHBOURS, _MOST_NEIGHBOURS + 1):
        other = np.clip(number + k, 0, len(times) - 1)
        gap = times[other] - times
        there = (other == number + k) & (np.abs(gap) < 3.0 * _SMOOTH_S)
        near = np.exp(-0.5 * (gap / _SMOOTH_S) ** 2) * there
        weight = near[:, None] * np.maximum(confidence[other], 1e-3)
        sums += weight * gap[:, None] ** np.arange(3)[:, None, None]
        moments += (weight * gap[:, None] ** np.arange(2)[:, None, None])[..., None] * joints[other]
    s0, s1, s2 = sums[..., None]
    spread = s0 * s2 - s1**2
    alone = spread < 1e-4 * _SMOOTH_S**2 * s0**2
    spread = np.where(alone, 1.0, spread)
    places = np.where(alone, joints, (s2 * moments[0] - s1 * moments[1]) / spread)
    return places, np.where(alone, 0.0, (s0 * moments[1] - s1 * moments[0]) / spread)
