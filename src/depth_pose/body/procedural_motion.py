"""The embedded motion source: people moving, made from published curves and designed postures.

`make_clip` gives smooth motion, `make_poses` thousands of varied poses; both come from the same
families (`depth_pose.body.procedural_motion_families`) and pass through the same gates: joint
limits, the shoulder's rhythm, limbs out of the body, feet on the floor. Nothing is taken from
recorded motion.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from depth_pose.body.angles import angles_from_rotations, rotations_from_angles
from depth_pose.body.contact import separate_limbs, walk_on_floor
from depth_pose.body.limits import clamp_angles, with_shoulder_rhythm
from depth_pose.body.motion import Clip, PoseSet, choose_for_coverage, join_poses, without_heading
from depth_pose.body.procedural_motion_draw import Draw
from depth_pose.body.procedural_motion_families import FAMILIES
from depth_pose.errors import ConfigError

Array = NDArray[np.float64]

Progress = Callable[[float], None]
"""Called with the fraction done, 0 to 1."""

POOL_PER_POSE = 5.0
"""How many poses are made for each one that is chosen."""

_TOO_DEEP_M = 0.03
_SMOOTH_S = 0.05


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
        The person starts near the origin facing about +z and wanders from there.

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
    t = np.arange(max(int(round(fps * seconds)), 2)) / fps
    motion = FAMILIES[name].motion(t, Draw(rng, ()))
    rotations = _through_gates(motion.angles).rotations
    # Pushed limbs and clamped joints start and stop suddenly; people do not.
    angles = angles_from_rotations(rotations)
    angles = np.degrees(np.unwrap(np.radians(angles), axis=0))
    angles = gaussian_filter1d(angles, _SMOOTH_S * fps, axis=0, mode="nearest")
    rotations = rotations_from_angles(angles)
    return Clip(name, float(fps), rotations, walk_on_floor(rotations, motion.lift))


def _through_gates(angles: Array):  # type: ignore[no-untyped-def]
    return separate_limbs(rotations_from_angles(clamp_angles(with_shoulder_rhythm(clamp_angles(angles)))))


CLIPS: dict[str, Callable[..., Clip]] = {name: partial(make_clip, name) for name in FAMILIES}
"""Generators of clips by name, called with ``fps, seconds, seed``."""


def make_pool(count: int, seed: int, progress: Progress | None = None) -> PoseSet:
    """Make random poses of all families by their shares, without choosing among them.

    Poses whose limbs cannot be brought out of the body are left out, so a few fewer than
    ``count`` come back.
    """
    total = sum(entry.share for entry in FAMILIES.values())
    parts = []
    for i, (name, entry) in enumerate(FAMILIES.items()):
        n = max(int(round(count * entry.share / total)), 1)
        draw = Draw(np.random.default_rng([seed, crc32(name.encode())]), (n,))
        motion = entry.motion(draw.uniform(0.0, 20.0), draw)
        separated = _through_gates(motion.angles)
        fine = separated.depth < _TOO_DEEP_M
        rotations = without_heading(separated.rotations[fine])
        parts.append(PoseSet(rotations, (name,) * len(rotations)))
        if progress is not None:
            progress((i + 1) / len(FAMILIES))
    return join_poses(*parts)


def make_poses(count: int = 8000, seed: int = 0, progress: Progress | None = None) -> PoseSet:
    """Make a set of poses that covers what people do in front of a sensor.

    Half are chosen from a pool several times larger, far apart from each other and denser where
    common motions are (`choose_for_coverage`); the other half are their mirror images.

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
    weights = np.array([FAMILIES[family].weight for family in pool.families])
    chosen = pool.take(choose_for_coverage(pool, half, weights, mirrored=True))
    if progress is not None:
        progress(1.0)
    both = join_poses(chosen, chosen.mirrored())
    return both.take(np.arange(count))
