r"""Exact search for the nearest entries of a PCA subspace (eq. 6).

PCA puts most of a distance into the first dimensions. With an entry :math:`x = (x_1, x_2)` split
into those and the rest, the triangle inequality gives

.. math:: \|x - y\|^2 \ge \|x_1 - y_1\|^2 + (\|x_2\| - \|y_2\|)^2,

so one pass over a quarter of the table bounds every distance from below. The entries with each
block's lowest bound are looked at first; they give a distance that rules out nearly all others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.steps import _search_kernels as kernels

_HEAD = 16
"""Dimensions in which every entry is compared."""


@dataclass(frozen=True)
class Nearest:
    """Entries (K,) of a table, nearest first, and their distances (K,) in the subspace."""

    entries: NDArray[np.int64]
    distances: NDArray[np.float32]


class SubspaceSearch:
    """Finds nearest neighbours in a fixed table.

    Parameters
    ----------
    table : (N, D) float32
        The dimensions in the order of falling variance, for speed.
    """

    def __init__(self, table: NDArray[np.float32]) -> None:
        self.table = np.ascontiguousarray(table, np.float32)
        self._head = np.ascontiguousarray(self.table[:, :_HEAD].T)
        self._rest_norms = np.linalg.norm(self.table[:, _HEAD:], axis=1).astype(np.float32)
        self._bounds = np.empty(len(self.table), np.float32)
        self._best = np.empty(-(-len(self.table) // kernels.BLOCK), np.int64)

    def find(self, point: NDArray[np.float32], count: int) -> Nearest:
        """Find the entries nearest to a point.

        Parameters
        ----------
        point : (D,) float32
        count : int
            At most so many.
        """
        count = min(count, len(self.table))
        distances, entries = np.empty(count, np.float32), np.empty(count, np.int64)
        rest_norm = np.float32(np.linalg.norm(point[_HEAD:]))
        kernels.bound_distances(self._head, self._rest_norms, point, rest_norm, self._bounds, self._best)
        kernels.search(self.table, self._bounds, self._best, point, distances, entries)
        return Nearest(entries, np.sqrt(distances))
