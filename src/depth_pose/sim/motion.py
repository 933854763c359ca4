"""Motions for the simulation: procedural ones by name, captured ones from files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from depth_pose.core.errors import ConfigError

if TYPE_CHECKING:
    from depth_pose.motion.clip import Clip


def load_motion(motion: str, fps: float, seconds: float, seed: int = 0) -> Clip:
    """Return a motion at a sensor's rate.

    Parameters
    ----------
    motion : str
        A name of `depth_pose.motion.procedural.generator.CLIPS` or `depth_pose.sim.function.FUNCTION_CLIPS`,
        or a BVH file.
    fps : float
        Frames per second.
    seconds : float
        Length; a captured motion may be shorter.
    seed : int
        Of a procedural motion.

    Raises
    ------
    ConfigError
        Where there is no such motion.
    """
    if motion.lower().endswith(".bvh"):
        from depth_pose.motion.bvh import read_bvh

        return resample_clip(read_bvh(Path(motion)), fps, seconds)
    from depth_pose.motion.procedural.generator import CLIPS, make_clip
    from depth_pose.sim.function import FUNCTION_CLIPS

    if motion in FUNCTION_CLIPS:
        return FUNCTION_CLIPS[motion](fps, seconds, seed)
    if motion not in CLIPS:
        known = ", ".join((*CLIPS, *FUNCTION_CLIPS))
        raise ConfigError(f"there is no motion {motion!r}; it is a .bvh file or one of {known}")
    return make_clip(motion, fps, seconds, seed)


def resample_clip(clip: Clip, fps: float, seconds: float) -> Clip:
    """Resample a clip at another rate; rotations and positions are interpolated."""
    from scipy.spatial.transform import Rotation, Slerp

    from depth_pose.motion.clip import Clip

    last = (len(clip) - 1) / clip.fps
    # the small addition keeps the last frame where the lengths agree
    count = max(1, int(np.floor(min(seconds, last + 1 / clip.fps) * fps + 1e-6)))
    times = np.minimum(np.arange(count) / fps, last)
    if len(clip) == 1:
        return Clip(clip.name, fps, clip.rotations.repeat(count, axis=0), clip.roots.repeat(count, axis=0))
    at = np.arange(len(clip)) / clip.fps
    rotations = np.stack(
        [
            Slerp(at, Rotation.from_matrix(clip.rotations[:, node]))(times).as_matrix()
            for node in range(clip.rotations.shape[1])
        ],
        axis=1,
    )
    roots = np.stack([np.interp(times, at, clip.roots[:, axis]) for axis in range(3)], axis=1)
    return Clip(clip.name, fps, rotations, roots)
