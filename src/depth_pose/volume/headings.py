"""Headings: the direction that a person faces, about the vertical.

A heading is the azimuth of the pelvis' forward axis in the world frame (y up), ``atan2(x, z)``, radians:
0 for facing +z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def headings_of(rotations: Array) -> Array:
    """Headings (T,) of segment rotations (T, 21, 3, 3)."""
    forward = rotations[..., 0, :, 2]
    return np.asarray(np.arctan2(forward[..., 0], forward[..., 2]))


def turns(headings: Array | float) -> Array:
    """Rotations about the vertical that lead from facing +z to given headings, (...) to (..., 3, 3)."""
    a = np.asarray(headings, np.float64)
    s, c, zero, one = np.sin(a), np.cos(a), np.zeros_like(a), np.ones_like(a)
    rows = [[c, zero, s], [zero, one, zero], [-s, zero, c]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def without_headings(rotations: Array) -> Array:
    """Poses (T, 21, 3, 3) turned so that the pelvis faces +z."""
    turn = turns(headings_of(rotations))
    return np.asarray(np.swapaxes(turn, -1, -2)[:, None] @ rotations)
