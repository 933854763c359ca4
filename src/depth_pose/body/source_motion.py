"""A recorded motion on its own skeleton, before it is retargeted to ours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
