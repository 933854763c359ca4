"""One person's motion on the floor at an even rate, low-passed, in the form that the analyses read."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.signal import butter, sosfiltfilt

from depth_pose.analysis.measures import Array, Mask
from depth_pose.body.angle_definitions import AGAINST_VERTICAL, JOINT_ANGLE_INDEX
from depth_pose.body.joint_angles import joint_covariances, measure_angles
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.export.tracks import Track, even, fill_gaps, whole

SURE = 0.5
"""Minimum confidence of a joint that is used. Set by hand: one half is an expected error of 10 cm."""
_CUTOFF_HZ = 6.0
"""Cut-off of the low-pass of joints: D. A. Winter, *Biomechanics and Motor Control of Human Movement*, 4th
ed., 2009, sec. 3.4, for walking."""
_BRIDGE_S = 0.15
"""Maximum duration of a gap that is filled: some dropped frames, a quarter of a step. Set by hand."""
_LEAST_RATE_HZ = 3 * _CUTOFF_HZ
"""Frames a second below which nothing is filtered."""
_CHUNK = 1000
"""Frames whose covariances are in memory at a time."""
UP = np.array([0.0, 0.0, 1.0])
"""Up on the floor."""


@dataclass(frozen=True)
class Motion:
    """One person over time, T frames at an even rate, z up, the floor at z = 0.

    Attributes
    ----------
    body_id : str
    rate_hz : float
    times : (T,) float64
        Seconds since the recording's first frame.
    present : (T,) bool
        Gaps of up to `_BRIDGE_S` are filled, with joints that are not sure.
    joints : (T, 19, 3) float64
        Metres, low-passed; NaN in gaps.
    raw : (T, 19, 3) float64
        The same without the low-pass.
    sure : (T, 19) bool
        Joints of confidence `SURE` or more.
    deviations : (T, 19) float64
        Standard deviation of each joint in one direction, metres.
    angles, angle_deviations : (T, 25) float64
        Of `depth_pose.body.angle_definitions.JOINT_ANGLES`, degrees; NaN and infinite where not measured.
    """

    body_id: str
    rate_hz: float
    times: Array
    present: Mask
    joints: Array
    raw: Array
    sure: Mask
    deviations: Array
    angles: Array
    angle_deviations: Array

    def __len__(self) -> int:
        return len(self.times)

    def at(self, name: str) -> Array:
        """Positions of a joint, (T, 3), metres."""
        return np.asarray(self.joints[:, JOINT_INDEX[name]])

    def is_sure(self, *names: str) -> Mask:
        """Whether all of these joints are there and sure, (T,)."""
        return np.asarray(self.present & self.sure[:, [JOINT_INDEX[n] for n in names]].all(axis=1))


def motion_on_floor(track: Track, step_s: float, start_ns: int, tilt_deg: float | None = 0.0) -> Motion:
    """Make the motion of a track that stands on the floor (z up, floor at z = 0).

    Parameters
    ----------
    track : Track
    step_s : float
        Time between frames of the even rate, seconds.
    start_ns : int
        Stamp of the recording's first frame.
    tilt_deg : float, optional
        Deviation of the floor's up direction, degrees; None if up is unknown, and the track not on the floor.

    Raises
    ------
    InputError
        Where no frame has all joints.
    """
    track = _bridged(even(whole(track), step_s), step_s)
    joints = _low_passed(track.positions, track.present, 1.0 / step_s)
    angles, deviations = measure_angles(
        joints,
        track.quats_xyzw,
        track.joint_confidence,
        track.joint_states,
        track.covariances,
        None if tilt_deg is None else UP,
    )
    upright = [JOINT_ANGLE_INDEX[name] for name in AGAINST_VERTICAL]
    deviations[:, upright] = np.hypot(deviations[:, upright], tilt_deg or 0.0)
    return Motion(
        body_id=track.body_id,
        rate_hz=1.0 / step_s,
        times=np.asarray((track.stamps_ns - start_ns) * 1e-9, np.float64),
        present=track.present,
        joints=joints,
        raw=track.positions,
        sure=track.joint_confidence >= SURE,
        deviations=_deviations(track),
        angles=angles,
        angle_deviations=deviations,
    )


def _bridged(track: Track, step_s: float) -> Track:
    """Fill short gaps."""
    filled = fill_gaps(track)
    for first, end in track.gaps():
        if (end - first) * step_s > _BRIDGE_S:
            filled.present[first:end] = False
            filled.positions[first:end] = filled.quats_xyzw[first:end] = np.nan
    return filled


def _deviations(track: Track) -> Array:
    """Return the standard deviation of each joint in one direction, (T, 19), metres."""
    out = np.empty(track.joint_confidence.shape)
    for first in range(0, len(track), _CHUNK):
        part = slice(first, first + _CHUNK)
        covariances = joint_covariances(track.joint_confidence[part], track.covariances[part])
        out[part] = np.sqrt(np.trace(covariances, axis1=-2, axis2=-1) / 3.0)
    return out


def _low_passed(joints: Array, present: Mask, rate_hz: float) -> Array:
    """Low-pass each part without gaps, without delay (fourth order, forward and backward)."""
    out = joints.copy()
    if rate_hz < _LEAST_RATE_HZ:
        return out
    order = butter(2, _CUTOFF_HZ, fs=rate_hz, output="sos")
    for first, end in runs(present):
        if end - first > 12:  # the length that the filter's ends need
            out[first:end] = sosfiltfilt(order, joints[first:end], axis=0, padlen=9)
    return out


def runs(mask: Mask) -> list[tuple[int, int]]:
    """Return where a mask is true: first frame, and the frame after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in list(pairwise(edges))[::2]]
