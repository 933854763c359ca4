r"""Exact search for the nearest entries of a PCA subspace (Ye et al. eq. 6).

PCA puts most of a distance into the first dimensions. With an entry :math:`x = (x_1, x_2)` split into those
and the rest, the triangle inequality gives

.. math:: \|x - y\|^2 \ge \|x_1 - y_1\|^2 + (\|x_2\| - \|y_2\|)^2,

so one pass over part of the table, kept as 16-bit integers, bounds every distance from below. The entries
with each block's lowest bound are examined first; their distance excludes nearly all others.

Plain NumPy (all distances by one product with the table, ``argpartition``, the nearest again) reads the whole
table and takes longer: for 128,000 entries of 16, 32, 48 and 64 dimensions on one thread 0.8, 2.1, 2.8 and
3.2 ms, against 0.5, 0.7, 1.2 and 1.8 ms here, the least of 30 runs each (`benchmarks/speed.py` compares them
on the bank's own).
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.match import _search_kernels as kernels

_HEAD = 24
"""Number of dimensions in which every entry is compared; affects only speed."""


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
        Dimensions in the order of decreasing variance, for speed.
    """

    def __init__(self, table: NDArray[np.float32]) -> None:
        self.table = np.ascontiguousarray(table, np.float32)
        head = self.table[:, :_HEAD].T
        head = np.pad(head, ((0, len(head) % 2), (0, 0)))  # to an even number
        self._steps = (np.abs(head).max(axis=1, initial=1e-6) / np.float32(32767)).astype(np.float32)
        self._head = np.ascontiguousarray(np.round(head / self._steps[:, None]).astype(np.int16))
        self._slack = np.float32(0.51 * np.linalg.norm(self._steps))  # rounding errs by half a step
        self._rest_norms = np.linalg.norm(self.table[:, _HEAD:], axis=1).astype(np.float32)
        self._lock = threading.Lock()  # of the arrays below, which every search uses
        self._bounds = np.empty(len(self.table), np.float32)
        self._best = np.empty(-(-len(self.table) // kernels.BLOCK), np.int64)

    def find(self, point: NDArray[np.float32], count: int) -> Nearest:
        r"""Find the entries nearest to a point: Ye et al. eq. 6, for several nearest entries in place of one.

        .. math:: \langle l, i \rangle = \arg\min_{l, i} \|\lambda_l^i - \gamma\| \qquad (6)

        An entry :math:`\lambda_l^i` is view i of exemplar l in the subspace, :math:`\gamma` the input there.

        Parameters
        ----------
        point : (D,) float32
        count : int
            Maximum number of entries.
        """
        count = min(count, len(self.table))
        distances, entries = np.empty(count, np.float32), np.empty(count, np.int64)
        point = np.ascontiguousarray(point, np.float32)
        head = np.zeros(len(self._head), np.float32)
        head[: len(point[:_HEAD])] = point[:_HEAD]
        rest_norm = np.float32(np.linalg.norm(point[_HEAD:]))
        bounds, best = self._bounds, self._best
        with self._lock:  # Ye et al. eq. 6: the least distances in the subspace, exactly
            kernels.bound_distances(self._head, self._steps, self._rest_norms, head, rest_norm, bounds, best)
            kernels.search(self.table, bounds, self._slack, best, point, distances, entries)
        return Nearest(entries, np.sqrt(distances))
