r"""The space in which descriptors are compared.

Descriptors of one pose differ between wearers. Their covariance *within* poses, over the wearers in training,
is whitened, so that changes by clothing count little and changes by pose count much. The first principal
components are kept, and the square of the rest, which grows when a volume resembles no training volume, for
instance under a wrong heading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ISOTROPIC, _UNKNOWN = 0.15, 0.5
"""Weight of uncorrelated noise relative to the wearers', in units of the mean variance between poses, and its
addition for few wearers, scaled by 1/n^2 for n known wearers. Chosen like the defaults of
`depth_pose.volume.config`."""


@dataclass(frozen=True, eq=False)
class DescriptorSpace:
    """An affine map of descriptors.

    Attributes
    ----------
    mean : (D,) float64
    whiten : (D, D) float64
        Makes the variance within poses 1 in every direction.
    basis : (D, q) float64
        Principal directions of the whitened training descriptors, orthonormal columns.
    """

    mean: Array
    whiten: Array
    basis: Array

    def split(self, descriptors: Array) -> tuple[Array, Array]:
        """Components (K, q) of descriptors (K, D), and the square of what they leave out, (K,)."""
        white = (descriptors - self.mean) @ self.whiten
        components = white @ self.basis
        rest = np.einsum("kd,kd->k", white, white) - np.einsum("kq,kq->k", components, components)
        return components, np.maximum(rest, 0.0)


def learn_space(views: list[list[Array]], components: int) -> DescriptorSpace:
    """Make the space from descriptors of the same frames: for each view, of each wearer, (N, D)."""
    poses = [np.mean(wearers, axis=0) for wearers in views]
    together = np.concatenate(poses)
    mean = together.mean(axis=0)
    between = float(((together - mean) ** 2).sum()) / len(together)
    dimensions = together.shape[1]
    isotropic = _ISOTROPIC + _UNKNOWN / len(views[0]) ** 2
    within = isotropic * between / dimensions * np.eye(dimensions)
    for pose, wearers in zip(poses, views, strict=True):
        degrees = len(pose) * max(len(wearers) - 1, 1) * len(views)
        for v in wearers:
            within += (v - pose).T @ (v - pose) / degrees
    values, vectors = np.linalg.eigh(within)
    whiten = vectors @ np.diag(1.0 / np.sqrt(values)) @ vectors.T
    _, _, vt = np.linalg.svd((together - mean) @ whiten, full_matrices=False)
    return DescriptorSpace(mean, whiten, np.ascontiguousarray(vt[:components].T))
