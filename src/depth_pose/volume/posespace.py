"""The latent space of poses: principal components of segment rotations (Sec. 5).

A pose is the nine numbers of each segment's rotation relative to the heading, and the position of the
pelvis relative to the volume's centroid. Rotation matrices, not joint angles or rotation vectors:
those wrap, and a mean of wrapped angles is not a pose. Matrices from the latent space are replaced by the
nearest rotations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import nearest_rotation

Array = NDArray[np.float64]

_OFFSET_WEIGHT = 3.0
"""Weight of a metre of the pelvis's offset relative to a matrix entry of 1. Set by hand."""


@dataclass(frozen=True, eq=False)
class PoseSpace:
    """Principal components of poses.

    Attributes
    ----------
    mean : (192,) float64
    basis : (192, k) float64
    """

    mean: Array
    basis: Array

    def encode(self, rotations: Array, offsets: Array) -> Array:
        """Components (N, k) of rotations (N, 21, 3, 3) and offsets (N, 3)."""
        return np.asarray((_flatten(rotations, offsets) - self.mean) @ self.basis)

    def decode(self, components: Array) -> tuple[Array, Array]:
        """Rotations (N, 21, 3, 3) and offsets (N, 3) of components (N, k)."""
        flat = components @ self.basis.T + self.mean
        return nearest_rotation(flat[:, :189].reshape(-1, 21, 3, 3)), flat[:, 189:] / _OFFSET_WEIGHT


def _flatten(rotations: Array, offsets: Array) -> Array:
    return np.concatenate([rotations.reshape(-1, 189), _OFFSET_WEIGHT * offsets], axis=1)


def learn_pose_space(rotations: Array, offsets: Array, variance: float) -> PoseSpace:
    """Keep as many components as hold a share of the variance."""
    flat = _flatten(rotations, offsets)
    mean = flat.mean(axis=0)
    _, s, vt = np.linalg.svd(flat - mean, full_matrices=False)
    share = np.cumsum(s**2) / max(float((s**2).sum()), 1e-12)
    keep = int(np.searchsorted(share, variance - 1e-12)) + 1
    return PoseSpace(mean, np.ascontiguousarray(vt[: min(keep, len(s))].T))
