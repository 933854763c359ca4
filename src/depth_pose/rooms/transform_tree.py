"""Chains of static transforms between coordinate frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.core.rotations import quat_to_matrix

Array = NDArray[np.float64]


def pose_matrix(values: Sequence[float]) -> Array:
    """Return the transform (4, 4) of x, y, z, qx, qy, qz, qw; metres.

    Raises
    ------
    ConfigError
        Where the values are not finite, or the quaternion is zero.
    """
    found = np.asarray(values, np.float64)
    size = float(np.linalg.norm(found[3:]))
    if not np.isfinite(found).all() or size < 1e-6:
        raise ConfigError(f"the pose {list(values)} has no place or no rotation; give x y z qx qy qz qw")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = quat_to_matrix(found[3:] / size), found[:3]
    return T


class TransformTree:
    """Frames with their parents, as on ``/tf_static``: each has at most one parent."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Array]] = {}

    def add(self, parent: str, child: str, T_parent_child: Array) -> None:
        """Add a frame, or move it."""
        self._parents[child.lstrip("/")] = (parent.lstrip("/"), T_parent_child)

    def parents(self) -> dict[str, str]:
        """Return every frame that has a parent, with that parent."""
        return {child: parent for child, (parent, _) in self._parents.items()}

    def find(self, target: str, source: str) -> Array | None:
        """Return ``T_target_source`` (4, 4); None if no chain of frames connects them, or one is circular."""
        root, T_root_source = self.root_of(source)
        other, T_other_target = self.root_of(target)
        if root is None or root != other:
            return None
        return np.asarray(np.linalg.inv(T_other_target) @ T_root_source)

    def root_of(self, frame: str) -> tuple[str | None, Array]:
        """Return the root of a frame, itself if it has no parent, and its pose there; None in a circle."""
        at, T_at_frame = frame.lstrip("/"), np.eye(4)
        for _ in range(len(self._parents) + 1):
            if at not in self._parents:
                return at, T_at_frame
            at, T_parent_at = self._parents[at]
            T_at_frame = T_parent_at @ T_at_frame
        return None, T_at_frame
