"""The embedded motion source: people moving, made from published curves and designed postures.

`make_clip` gives smooth motion, `make_poses` thousands of varied poses; both come from the same
families (`depth_pose.motion.procedural.families`), the poses from everyday postures as well
(`depth_pose.motion.procedural.postures`), and pass through the same gates: joint
limits, the shoulder's rhythm, limbs out of the body, feet on the floor. Nothing is taken from
recorded motion.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from depth_pose.body.angles import angles_from_rotations, rotations_from_angles
from depth_pose.body.limits import clamp_rotations, violation
from depth_pose.core.errors import ConfigError
from depth_pose.core.rotations import nearest_rotation
from depth_pose.motion.clip import Clip, PoseSet, choose_for_coverage, join_poses, without_heading
from depth_pose.motion.contact import separate_limbs, walk_on_floor
from depth_pose.motion.procedural.draw import Draw
from depth_pose.motion.procedural.families import FAMILIES
from depth_pose.motion.procedural.parts import Motion
from depth_pose.motion.procedural.postures.parts import bring_through_gates
from depth_pose.motion.procedural.postures.sampler import sample_postures

Array = NDArray[np.float64]

Progress = Callable[[float], None]
"""Called with the fraction done, 0 to 1."""

POOL_PER_POSE = 5.0
"""Poses made for each one chosen. benchmarks/banks.py coverage measures the result."""

APART_SHARE = 0.5
"""Share of a set that is chosen for coverage; the rest follows the families' shares.

Chosen with ``benchmarks/banks.py coverage`` in view, as were the families' shares and weights.
"""

POSTURE_SHARES: dict[str, float] = {
    "sit": 5.0,
    "lie": 1.5,
    "reach": 1.5,
    "kneel": 1.0,
    "squat": 0.8,
    "bend": 0.8,
    "crawl": 0.5,
}
"""Share of each everyday posture in the pool, beside the families' shares."""

STAY_WITHIN_M = 1.0
"""Maximum distance of a clip's path from its middle (m), so that a runner stays in view."""

_TOO_DEEP_M = 0.03
"""Maximum depth of a limb inside the body, metres; deeper poses are dropped."""

_TOO_STRAINED_DEG = 15.0
"""Maximum violation of a joint limit (degrees); poses beyond it are dropped."""

_SMOOTH_S = (0.06, 0.04, 0.025)
"""Widths of the Gaussians that smooth a clip one after the other, seconds."""

_SLOW_S = 0.8
"""Width (s) of the Gaussian that separates a path's slow part: longer than a stride."""


def make_clip(name: str, fps: float = 30.0, seconds: float = 10.0, seed: int = 0) -> Clip:
    """Make a smooth motion of the reference body.

    Parameters
    ----------
    name : str
        One of `CLIPS`.
    fps : float
        Frames a second.
    seconds : float
        Length.
    seed : int
        The same seed gives the same motion; others vary everything about it.

    Returns
    -------
    Clip
        The person begins facing about +z and stays within about `STAY_WITHIN_M` of the origin.

    Raises
    ------
    ConfigError
        For a name that is not in `CLIPS`, or a rate or length that is not positive.
    """
    if name not in FAMILIES:
        raise ConfigError(f"unknown motion {name!r}; there are: {', '.join(sorted(FAMILIES))}")
    if fps <= 0 or seconds <= 0:
        raise ConfigError(f"a clip needs a positive rate and length, not {fps} frames/s and {seconds} s")
    rng = np.random.default_rng([seed, crc32(name.encode())])
    t = np.arange(max(round(fps * seconds), 2)) / fps
    return clip_from_motion(name, FAMILIES[name].motion(t, Draw(rng, ())), fps)


def clip_from_motion(name: str, motion: Motion, fps: float, stays: bool = True) -> Clip:
    """Make a clip of postures over time: within all limits, smooth, feet on the floor.

    With ``stays`` the person stays within about `STAY_WITHIN_M` of the path's middle.
    """
    rotations = bring_through_gates(motion.angles).rotations
    # Pushed limbs and clamped joints start and stop suddenly; people do not. Smoothing moves
    # limbs into the body again, less each time.
    for sigma_s in _SMOOTH_S:
        rotations = separate_limbs(clamp_rotations(smooth_rotations(rotations, sigma_s * fps))).rotations
    rotations = smooth_rotations(rotations, _SMOOTH_S[-1] * fps)
    roots = walk_on_floor(rotations, motion.lift)
    return Clip(name, float(fps), rotations, _stay_near(roots, fps) if stays else roots)


def smooth_rotations(rotations: Array, sigma_frames: float) -> Array:
    """Smooth rotations in time by a Gaussian, (T, ..., 3, 3); the results are rotations."""
    return nearest_rotation(gaussian_filter1d(rotations, sigma_frames, axis=0, mode="nearest"))


def _stay_near(roots: Array, fps: float) -> Array:
    """Keep a path within `STAY_WITHIN_M` of its middle by removing its slow part, like a treadmill."""
    level = roots[:, [0, 2]]
    slow = gaussian_filter1d(level, _SLOW_S * fps, axis=0, mode="nearest")
    middle = (slow.max(axis=0) + slow.min(axis=0)) / 2
    far = float(np.linalg.norm(slow - middle, axis=1).max())
    out = roots.copy()
    out[:, [0, 2]] = level - slow + (slow - middle) * min(1.0, STAY_WITHIN_M / max(far, 1e-9))
    return np.asarray(out)


CLIPS: dict[str, Callable[..., Clip]] = {name: partial(make_clip, name) for name in FAMILIES}
"""Generators of clips by name, called with ``fps, seconds, seed``."""


def make_pool(count: int, seed: int, progress: Progress | None = None) -> PoseSet:
    """Make random poses of all families by their shares, without choosing among them.

    Poses with limbs that cannot be moved out of the body within the joint limits are dropped,
    so a few fewer than ``count`` come back.
    """
    per_share = count / (sum(e.share for e in FAMILIES.values()) + sum(POSTURE_SHARES.values()))
    makers = [partial(_of_family, name) for name in FAMILIES] + [
        partial(_of_posture, name) for name in POSTURE_SHARES
    ]
    parts = []
    for i, make in enumerate(makers):
        parts.append(make(per_share, seed))
        if progress is not None:
            progress((i + 1) / len(makers))
    return join_poses(*parts)


def _of_family(name: str, per_share: float, seed: int) -> PoseSet:
    """Make a pool's poses of one family; poses that fail the checks are dropped."""
    n = max(round(per_share * FAMILIES[name].share), 1)
    draw = Draw(np.random.default_rng([seed, crc32(name.encode())]), (n,))
    motion = FAMILIES[name].motion(draw.uniform(0.0, 20.0), draw)
    separated = bring_through_gates(motion.angles)
    strain = violation(angles_from_rotations(separated.rotations)).max(axis=-1)
    fine = (separated.depth < _TOO_DEEP_M) & (strain < _TOO_STRAINED_DEG)
    rotations = without_heading(separated.rotations[fine])
    return PoseSet(rotations, (name,) * len(rotations))


def _of_posture(name: str, per_share: float, seed: int) -> PoseSet:
    """Make a pool's poses of one posture.

    Lying postures stay upright: exemplars are matched in the axes of their own cloud.
    """
    rng = np.random.default_rng([seed, crc32(name.encode())])
    angles = sample_postures(name, rng, max(round(per_share * POSTURE_SHARES[name]), 1)).angles
    return PoseSet(without_heading(rotations_from_angles(angles)), (name,) * len(angles))


def _choose(pool: PoseSet, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Choose rows: first for coverage, then at random, so that common motions are dense."""
    weights = np.array([FAMILIES[f].weight if f in FAMILIES else 1.0 for f in pool.families])
    apart = choose_for_coverage(pool, round(count * APART_SHARE), weights, mirrored=True)
    others = np.setdiff1d(np.arange(len(pool)), apart)
    common = rng.choice(others, count - len(apart), replace=False)
    return np.concatenate([apart, common])


def make_poses(count: int = 10_000, seed: int = 0, progress: Progress | None = None) -> PoseSet:
    """Make a set of poses that covers what people do in front of a sensor.

    They are chosen from a pool several times larger: half of them to lie far apart from each
    other (`choose_for_coverage`), so that rare postures are there, half at random, so that common
    ones are dense. Every second half mirrors the first.

    Parameters
    ----------
    count : int
        Number of poses.
    seed : int
        The same seed gives the same poses.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    PoseSet
        Facing +z; row ``i + ceil(count / 2)`` mirrors row ``i``.
    """
    if count < 2:
        raise ConfigError(f"a set needs at least 2 poses, not {count}")
    half = (count + 1) // 2
    pool = make_pool(
        int(half * 2 * POOL_PER_POSE), seed, None if progress is None else lambda f: progress(0.6 * f)
    )
    chosen = pool.take(_choose(pool, half, np.random.default_rng([seed, 1])))
    if progress is not None:
        progress(1.0)
    both = join_poses(chosen, chosen.mirrored())
    return both.take(np.arange(count))
