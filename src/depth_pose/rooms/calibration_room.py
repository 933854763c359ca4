"""Floors, the empty room and priors, as terms of the room's least-squares problem."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from depth_pose.core.rotations import cross_matrix
from depth_pose.detect.floor import Floor
from depth_pose.rooms.background import RoomSurface
from depth_pose.rooms.calibration_state import NEAR, NEAR_M, OFFSET, SIZE, CameraState, Normal, motion_rows

Array = NDArray[np.float64]

_NEAR_SPREAD_M = 0.02
"""Standard deviation of the depth bias across sensors (m)."""
_OFFSET_SPREAD_S = 0.3
"""Standard deviation of clock offsets (s). Set by hand."""

_UP_SPREAD, _HEIGHT_SPREAD_M = np.radians(0.5), 0.03
"""Standard deviation of a floor found in depth images: direction (radians), height (m). Set by hand."""
_ROUGH = 8.0
"""Factor on it for a floor estimated from people. Set by hand."""

_FIXED = 1e9
"""Weight of fixed unknowns (1/m^2): far above all others."""

_SURFACE_M, _SURFACE_PER_M = 0.012, 0.0015
"""Standard deviation of the empty room's points (m), and its growth with the squared distance (1/m), as for
disparity sensors. Set by hand."""
_OVER_TIME = 1.5
"""Standard deviation that an average over time keeps, as a multiple of that over time, since noisy sensors
are biased as well. Chosen on simulated pairs and a trio from 0, 0.5, 1 and 2."""
_ALIKE_POINTS = 20.0
"""Number of neighbouring points with a common error. Set by hand."""
_SAME_COS = np.cos(np.radians(35.0))
"""Maximum angle between the normals of one surface in two cameras. Set by hand."""


def add_priors(normal: Normal, states: Sequence[CameraState], floors: Sequence[Floor]) -> None:
    """Add floors and the priors of clock offset and depth bias; fix the first camera's pose."""
    for c, (state, floor) in enumerate(zip(states, floors, strict=True)):
        rough = 1.0 if floor.source == "depth images" else _ROUGH
        up = state.T_room_camera[:3, :3] @ floor.up
        J = np.zeros((2, SIZE))
        J[:, :3] = -cross_matrix(*up)[:2]
        normal.add([(c, J)], up[:2], np.full(2, 1.0 / (_UP_SPREAD * rough) ** 2))
        foot = state.to_room(-floor.height * floor.up)
        normal.add(
            [(c, motion_rows(foot[None])[0, 2:])], foot[2:], np.full(1, 1.0 / (_HEIGHT_SPREAD_M * rough) ** 2)
        )
        J = np.zeros((2, SIZE))
        J[0, OFFSET], J[1, NEAR] = 1.0, 1.0
        residual = np.array([state.offset, state.near - NEAR_M])
        spreads = np.array([_OFFSET_SPREAD_S if c else 1e-6, _NEAR_SPREAD_M])
        normal.add([(c, J)], residual, 1.0 / spreads**2)
    J = np.zeros((3, SIZE))  # no rotation about the vertical, no translation
    J[0, 2] = J[1, 3] = J[2, 4] = 1.0
    normal.add([(0, J)], np.zeros(3), np.full(3, _FIXED))


def add_fixed(normal: Normal, pairs: Sequence[tuple[int, int]]) -> None:
    """Move both cameras of each pair alike, so that they keep their relative pose."""
    J = np.eye(6, SIZE)
    for a, b in pairs:
        normal.add([(a, J), (b, -J)], np.zeros(6), np.full(6, _FIXED))


class SurfaceTerm(NamedTuple):
    """The empty room in two cameras, with a tree of the points of each, camera frames."""

    a: int
    b: int
    surface_a: RoomSurface
    surface_b: RoomSurface
    tree_b: cKDTree


def pair_surfaces(surfaces: Sequence[RoomSurface | None]) -> list[SurfaceTerm]:
    """Pair the cameras' surfaces, each pair both ways."""
    trees = [cKDTree(s.points) if s is not None and len(s.points) else None for s in surfaces]
    return [
        SurfaceTerm(a, b, first, second, tree)
        for a, b in permutations(range(len(surfaces)), 2)
        if (first := surfaces[a]) is not None and (second := surfaces[b]) is not None
        if trees[a] is not None and (tree := trees[b]) is not None
    ]


def add_surfaces(
    normal: Normal, states: Sequence[CameraState], terms: Sequence[SurfaceTerm], reach_m: float
) -> list[tuple[int, float]]:
    """Add points of a that lie near a surface of b; return the count and mean residual (m) of each term.

    Parameters
    ----------
    normal, states, terms
    reach_m : float
        Maximum distance (m) of a pair; at half of it the weight is halved.
    """
    found = []
    for a, b, surface_a, surface_b, tree_b in terms:
        first, second = states[a], states[b]
        T_b_a = np.linalg.inv(second.T_room_camera) @ first.T_room_camera
        distance, index = tree_b.query(
            surface_a.points @ T_b_a[:3, :3].T + T_b_a[:3, 3], distance_upper_bound=max(reach_m, 0.1)
        )
        there = np.flatnonzero(np.isfinite(distance))
        n = surface_b.normals[index[there]] @ second.T_room_camera[:3, :3].T
        na = surface_a.normals[there] @ first.T_room_camera[:3, :3].T
        qa = first.to_room(surface_a.points[there])
        qb = second.to_room(surface_b.points[index[there]])
        residual = np.sum(n * (qa - qb), axis=1)
        good = (np.sum(n * na, axis=1) > _SAME_COS) & (np.abs(residual) < reach_m)
        if not good.any():
            found.append((0, 0.0))
            continue
        n, qa, residual = n[good], qa[good], residual[good]
        spread = _variance(surface_a, there[good]) + _variance(surface_b, index[there[good]])
        J = np.zeros((len(n), SIZE))
        J[:, :3], J[:, 3:6] = np.cross(qa, n), n
        weight = (1.0 - (residual / reach_m) ** 2) ** 2 / (spread * _ALIKE_POINTS)
        normal.add([(a, J), (b, -J)], residual, weight)
        found.append((len(n), float(np.abs(residual).mean())))
    return found


def _variance(surface: RoomSurface, rows: NDArray[np.int64]) -> Array:
    """Return the variance (N,) of points of a surface, m^2."""
    far = np.sum(surface.points[rows] ** 2, axis=1)
    return _SURFACE_M**2 + (_SURFACE_PER_M * far) ** 2 + (_OVER_TIME * surface.spread[rows]) ** 2
