"""A recorded motion on its own skeleton, before it is retargeted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError

Array = NDArray[np.float64]

MOST_MOTION_BYTES = 1 << 28
"""Largest file of motion, 256 MiB: an hour of 60 channels at 120 frames a second."""

MOST_JOINTS = 1000
"""Maximum number of joints; people have 20 to 200, with fingers and face."""

MOST_ROTATIONS = 20_000_000
"""Frames times joints: an hour of 46 joints at 120 frames a second, 1.4 GB."""


def check_motion_size(path: Path | str, frames: int, joints: int) -> None:
    """Refuse motion with an implausible number of frames or joints, before allocating it.

    Raises
    ------
    InputError
        Where there are too many.
    """
    if joints > MOST_JOINTS or frames * joints > MOST_ROTATIONS:
        raise InputError(
            f"{path}: {frames} frames of {joints} joints are too many; at most {MOST_JOINTS} joints, and "
            f"{MOST_ROTATIONS} of frames times joints, are read: cut it into parts"
        )


@dataclass(frozen=True)
class SourceMotion:
    """A hierarchy of joints and its motion, in the file's units and axes.

    Attributes
    ----------
    name : str
    fps : float
    joints : tuple of str
        Parents before children. Ends of chains are called ``NAME/end`` after their parent.
    parents : (J,) int64
        -1 for the root.
    offsets : (J, 3) float64
        Each joint relative to its parent in the rest pose.
    rotations : (T, J, 3, 3) float64
        Rotation of each joint's segment, rest pose to world (not relative to the parent).
    root : (T, 3) float64
        Position of the root joint.
    """

    name: str
    fps: float
    joints: tuple[str, ...]
    parents: NDArray[np.int64]
    offsets: Array
    rotations: Array
    root: Array

    def rest_positions(self) -> Array:
        """Positions of the joints in the rest pose, (J, 3)."""
        out = np.zeros_like(self.offsets)
        for j, parent in enumerate(self.parents):
            out[j] = self.offsets[j] if parent < 0 else out[parent] + self.offsets[j]
        return out

    def positions(self) -> Array:
        """Positions of the joints in every frame, (T, J, 3)."""
        out = np.empty((*self.rotations.shape[:2], 3))
        for j, parent in enumerate(self.parents):
            if parent < 0:
                out[:, j] = self.root
            else:
                out[:, j] = out[:, parent] + self.rotations[:, parent] @ self.offsets[j]
        return out
