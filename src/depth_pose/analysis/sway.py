"""Sway of somebody who stands still.

The measures are those of T. E. Prieto et al., *Measures of postural steadiness*, IEEE Trans. Biomed. Eng.
43, 1996, of the centre of mass in place of the centre of pressure, which no camera sees. The centre of mass
is the weighted mean of segments: masses and centres of P. de Leva, *Adjustments to Zatsiorsky-Seluyanov's
segment inertia parameters*, J. Biomech. 29, 1996, rounded, both sexes averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.stats import chi2

from depth_pose.analysis.measures import Array, Mask, Measure, refused, too_slow
from depth_pose.analysis.motion import Motion, runs
from depth_pose.analysis.rising import pelvis_share
from depth_pose.core.rotations import unit_vectors
from depth_pose.core.skeleton import JOINT_INDEX

GROUP = "standing still"

NAMES = {
    "sway forward and back": "mm",
    "sway to the sides": "mm",
    "speed of sway": "mm/s",
    "area of sway (95 %)": "cm2",
}
"""Measures of sway and their units."""

LEAST_S = 8.0
"""Minimum time of standing still. Set by hand: sway has parts of several seconds."""
_STILL_M = 0.08
"""Maximum distance of the pelvis from its middle, in which somebody stands. Set by hand: less than a step."""
_UPRIGHT = 0.9
"""Minimum height of the pelvis as a share of that on straight legs."""
_BAND_HZ = 1.0
"""Sway of the centre of mass is slower than this, measuring noise is not. Winter 1995: .2 to .5 Hz."""

_LEAST_RATE_HZ = 10.0
"""Minimum number of frames a second. Set by hand: ten times the band."""

_SEGMENTS: tuple[tuple[str, str, float, float], ...] = (
    ("neck", "head", 0.068, 1.0),
    ("pelvis", "neck", 0.430, 0.5),
    *((f"{side}_shoulder", f"{side}_elbow", 0.026, 0.58) for side in ("left", "right")),
    *((f"{side}_elbow", f"{side}_wrist", 0.021, 0.6) for side in ("left", "right")),
    *((f"{side}_hip", f"{side}_knee", 0.145, 0.39) for side in ("left", "right")),
    *((f"{side}_knee", f"{side}_ankle", 0.046, 0.44) for side in ("left", "right")),
    *((f"{side}_ankle", f"{side}_foot", 0.013, 0.5) for side in ("left", "right")),
)
"""Segments: from, to, share of the body's mass, place of the centre along it."""


@dataclass(frozen=True)
class Sway:
    """What is known of somebody's standing.

    Attributes
    ----------
    path : (T, 2) float64
        The centre of mass about its middle: forward and to the left, millimetres; empty where unknown.
    times : (T,) float64
        Seconds.
    measures : tuple of Measure
    """

    path: Array
    times: Array
    measures: tuple[Measure, ...]


def centre_of_mass(joints: Array) -> Array:
    """Centre of mass of bodies, (..., 19, 3) to (..., 3), metres."""
    out, total = np.zeros(joints.shape[:-2] + (3,)), 0.0
    for start, end, mass, part in _SEGMENTS:
        a, b = (joints[..., JOINT_INDEX[name], :] for name in (start, end))
        out += mass * (a + part * (b - a))
        total += mass
    return np.asarray(out / total)


def analyse_sway(motion: Motion) -> Sway:
    """Find the longest time of standing still, and measure the sway in it."""
    if reason := too_slow(motion.rate_hz, _LEAST_RATE_HZ):
        return Sway(np.zeros((0, 2)), np.zeros(0), refused(GROUP, NAMES, reason))
    first, end = max(_standing(motion), key=lambda part: part[1] - part[0], default=(0, 0))
    seconds = (end - first) / motion.rate_hz
    if seconds < LEAST_S:
        reason = f"nobody stands still for {LEAST_S:.0f} s; the longest time is {seconds:.1f} s"
        return Sway(np.zeros((0, 2)), np.zeros(0), refused(GROUP, NAMES, reason))
    left = np.mean((motion.at("left_hip") - motion.at("right_hip"))[first:end, :2], axis=0)
    aside = unit_vectors(left)
    ahead = np.array([aside[1], -aside[0]])
    raw = 1e3 * centre_of_mass(motion.raw[first:end])[:, :2] @ np.stack([ahead, aside], axis=1)
    path = _slow(raw, motion.rate_hz)
    noise = float(np.std(raw - path))  # of one frame; less of it is below the cut-off
    noise *= float(np.sqrt(2 * _BAND_HZ / motion.rate_hz))
    path = path - path.mean(axis=0)
    return Sway(path, motion.times[first:end], _measures(path, noise, motion.rate_hz))


def _slow(path: Array, rate_hz: float) -> Array:
    order = butter(2, _BAND_HZ, fs=rate_hz, output="sos")
    return np.asarray(sosfiltfilt(order, path, axis=0))


def _standing(motion: Motion) -> list[tuple[int, int]]:
    """Return times in which the pelvis stays near its middle, upright, and the legs are sure."""
    with np.errstate(invalid="ignore"):
        upright: Mask = pelvis_share(motion) > _UPRIGHT
    out = []
    for first, end in runs(upright & motion.is_sure("left_hip", "right_hip", "pelvis", "neck")):
        place = motion.at("pelvis")[first:end, :2]
        begin = 0
        while begin < len(place):
            stop = begin + 1
            low = high = place[begin]
            while stop < len(place):
                low, high = np.minimum(low, place[stop]), np.maximum(high, place[stop])
                if np.linalg.norm(high - low) > 2 * _STILL_M:
                    break
                stop += 1
            out.append((first + begin, first + stop))
            begin = stop
    return out


def _measures(path: Array, noise_mm: float, rate_hz: float) -> tuple[Measure, ...]:
    """Root mean squares, speed and area; their deviations by the noise and the length of the record."""
    frames = len(path)
    free = max(2.0, frames / rate_hz * 2 * _BAND_HZ / 3)  # independent values: sway is mostly below a third
    rms = path.std(axis=0)
    off = np.hypot(rms / np.sqrt(2 * free), noise_mm)
    speed = float(np.linalg.norm(np.diff(path, axis=0), axis=1).mean() * rate_hz)
    speed_off = float(np.hypot(speed / np.sqrt(2 * free), noise_mm * 2 * np.pi * 0.5 * _BAND_HZ))
    area = float(np.pi * chi2.ppf(0.95, 2) * np.sqrt(np.linalg.det(np.cov(path.T)))) / 100.0
    area_off = area * float(np.hypot(*(off / np.maximum(rms, 1e-9))))

    def measure(name: str, value: float, deviation: float) -> Measure:
        return Measure(GROUP, name, "", value, deviation, NAMES[name], frames, "frames", frames)

    return (
        measure("sway forward and back", float(rms[0]), float(off[0])),
        measure("sway to the sides", float(rms[1]), float(off[1])),
        measure("speed of sway", speed, speed_off),
        measure("area of sway (95 %)", area, area_off),
    )
