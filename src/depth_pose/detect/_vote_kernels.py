"""Compiled loops from the net's torso votes to clusters, for `depth_pose.detect.finder`.

``image`` is a `NetImage`. Flat indices count its pixels, row by row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core._camera_kernels import ray
from depth_pose.core.kernels import njit

_CELL_M = 0.1
"""Cell size (m) of the histogram of votes."""

CELLS = (128, 64, 128)
"""Number of cells along x, y, z; votes beyond 6.4 m, 3.2 m and 12.8 m are counted at the edge."""

_LEAST_IN_CELL = 0.1
"""Least share of a person's least area in the densest cell of the votes."""

_SHIFTS = 8
"""Maximum number of mean-shift steps; most converge in four."""

_REST_M = 0.01
"""Step (m) below which a mean has converged; set by hand."""

_KEEN_M = 0.1
"""Votes with a larger predicted error (m) have less weight."""

_ALONG = 0.5
"""Weight of the squared distance of votes along the camera's axis."""


class TorsoVotes(NamedTuple):
    """The voting pixels.

    Attributes
    ----------
    flat : (N,) int64
        Indices of the pixels.
    points : (N, 3) float64
        Torso positions that they vote for, camera frame, metres.
    weights, areas : (N,) float64
        Weights, and visible areas, m^2.
    """

    flat: NDArray[np.int64]
    points: NDArray[np.float64]
    weights: NDArray[np.float64]
    areas: NDArray[np.float64]

    def first(self, count: int) -> TorsoVotes:
        """Return views of the first ``count`` votes."""
        return TorsoVotes(self.flat[:count], self.points[:count], self.weights[:count], self.areas[:count])


@njit(cache=True)
def collect_votes(image, mask, torso, least, out):
    """Collect the votes of pixels whose mask logit is at least ``least``, with their weights.

    The weight is the area that the pixel shows (m^2), times the probability, reduced if the vote is
    uncertain. ``out`` (TorsoVotes) has room for all pixels. Returns the number of votes.
    """
    grid, camera = image.depth, image.camera
    flat, votes, weights, areas = out
    count = 0
    for i in range(image.rows):
        for j in range(image.cols):
            z = grid[i, j]
            if z <= 0.0 or mask[i, j] < least:
                continue
            x, y = ray(camera, j, i)
            votes[count, 0] = x * z + torso[0, i, j]
            votes[count, 1] = y * z + torso[1, i, j]
            votes[count, 2] = z + torso[2, i, j]
            width = np.exp(torso[3, i, j])
            areas[count] = z * z / (camera.fx * camera.fy)
            weights[count] = areas[count] / (1.0 + np.exp(-mask[i, j])) * min(1.0, _KEEN_M / width)
            flat[count] = i * grid.shape[1] + j
            count += 1
    return count


@njit(cache=True)
def cell_of(vote):
    """Return the index of a vote's cell."""
    index = 0
    for a in range(3):
        low = 0.0 if a == 2 else -0.5 * CELLS[a]
        k = int(np.floor(vote[a] / _CELL_M - low))
        index = index * CELLS[a] + max(0, min(CELLS[a] - 1, k))
    return index


@njit(cache=True)
def find_modes(votes, weights, density, radius, least, most, modes):
    """Find the modes of the votes: means of all votes within ``radius``, each of at least ``least`` m^2.

    ``density`` (all cells) is zero on entry and again on return. Returns the number of modes.
    """
    n = votes.shape[0]
    cells = np.empty(n, np.int64)
    for k in range(n):
        cells[k] = cell_of(votes[k])
        density[cells[k]] += weights[k]
    taken = np.zeros(n, np.bool_)
    count = 0
    for _ in range(4 * most):
        best, seed = 0.0, -1
        for k in range(n):
            if not taken[k] and density[cells[k]] > best:
                best, seed = density[cells[k]], k
        if best < _LEAST_IN_CELL * least or count == most:
            break
        mean = votes[seed].copy()
        total = shift_mean(votes, weights, mean, radius)
        apart = True
        for m in range(count):
            apart &= apart2(modes[m], mean) > radius * radius
        if apart and total >= least:
            modes[count] = mean
            count += 1
        for k in range(n):
            if apart2(votes[k], mean) < radius * radius or cells[k] == cells[seed]:
                taken[k] = True
    for k in range(n):
        density[cells[k]] = 0.0
    return count


@njit(cache=True)
def shift_mean(votes, weights, mean, radius):
    """Move ``mean`` to the mean of the votes within ``radius`` until it converges; return their weight."""
    total = 0.0
    for _ in range(_SHIFTS):
        total, x, y, z = 0.0, 0.0, 0.0, 0.0
        for k in range(votes.shape[0]):
            if apart2(votes[k], mean) < radius * radius:
                w = weights[k]
                total += w
                x += w * votes[k, 0]
                y += w * votes[k, 1]
                z += w * votes[k, 2]
        if total <= 0.0:
            break
        x, y, z = x / total, y / total, z / total
        moved = abs(x - mean[0]) + abs(y - mean[1]) + abs(z - mean[2])
        mean[0], mean[1], mean[2] = x, y, z
        if moved < _REST_M:
            break
    return total


@njit(cache=True)
def apart2(a, b):
    """Compute the squared distance of two votes.

    The camera's axis has less weight, because votes err more along it.
    """
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + _ALONG * (a[2] - b[2]) ** 2


@njit(cache=True)
def assign_votes(flat, votes, modes, reach, labels, owner):
    """Assign the nearest mode (from 1) within ``reach`` to the listed pixels, in image and list."""
    for k in range(votes.shape[0]):
        best, owner[k] = reach * reach, 0
        for m in range(modes.shape[0]):
            d = apart2(votes[k], modes[m])
            if d < best:
                best, owner[k] = d, m + 1
        labels[flat[k] // labels.shape[1], flat[k] % labels.shape[1]] = owner[k]


@njit(cache=True)
def claim_pixels(image, mask, torso, least, torsos, reach):
    """Compute the torso that each pixel with a mask logit of ``least`` or more votes for, (H, W) uint8.

    From 1, in the order of ``torsos`` (P, 3); 0 if the vote lies farther than ``reach`` from all of them.
    """
    claims = np.zeros(mask.shape, np.uint8)
    vote = np.empty(3)
    for i in range(image.rows):
        for j in range(image.cols):
            z = image.depth[i, j]
            if z <= 0.0 or mask[i, j] < least:
                continue
            x, y = ray(image.camera, j, i)
            vote[0] = x * z + torso[0, i, j]
            vote[1] = y * z + torso[1, i, j]
            vote[2] = z + torso[2, i, j]
            best = reach * reach
            for p in range(torsos.shape[0]):
                d = apart2(vote, torsos[p])
                if d < best:
                    best, claims[i, j] = d, p + 1
    return claims
