"""Joint refinement of all cameras of a room: people first, then the empty room from coarse to fine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import cross_matrix
from depth_pose.detect.floor import Floor
from depth_pose.rooms.background import RoomSurface
from depth_pose.rooms.calibration_people import PeopleTerm, add_people
from depth_pose.rooms.calibration_room import SurfaceTerm, add_fixed, add_priors, add_surfaces, pair_surfaces
from depth_pose.rooms.calibration_state import SIZE, CameraState, Normal

Array = NDArray[np.float64]

_PEOPLE_ROUNDS = 12
"""Rounds of reweighted Gauss-Newton with people only. Set by hand."""
_UNKNOWN = 0.01
"""Weight of unconstrained unknowns (1/m^2): a standard deviation of 10 m."""
_REACHES_M = (0.3, 0.3, 0.25, 0.25, 0.2, 0.2, 0.15, 0.15, 0.1, 0.1, 0.1, 0.08, 0.08, 0.08)
"""Maximum distance of the empty room's correspondences in each round (m). Set by hand."""


@dataclass(frozen=True)
class Solution:
    """Solved cameras.

    Attributes
    ----------
    states : tuple of CameraState
    covariance : (C * SIZE, C * SIZE) float64
        Of the unknowns of `depth_pose.rooms.calibration_terms`.
    covariance_by_room : (C * SIZE, C * SIZE) float64
        The same from floors and the empty room alone.
    residual : float
        Median distance of joints that two cameras see, metres; NaN without people.
    surfaces : tuple of (int, int, int, float)
        For each pair of cameras with a common surface: both, the points, their mean distance (m).
    """

    states: tuple[CameraState, ...]
    covariance: Array
    covariance_by_room: Array
    residual: float
    surfaces: tuple[tuple[int, int, int, float], ...]


def solve_room(
    states: Sequence[CameraState],
    floors: Sequence[Floor],
    people: Sequence[PeopleTerm],
    surfaces: Sequence[RoomSurface | None],
    fixed: Sequence[tuple[int, int]] = (),
) -> Solution:
    """Refine the cameras of a room.

    Parameters
    ----------
    states : sequence of CameraState
        First estimates, in the floor frame of the first camera.
    floors : sequence of Floor
        Of each camera, camera frame.
    people : sequence of PeopleTerm
    surfaces : sequence of RoomSurface or None
        The empty room by each camera; None where it is not known.
    fixed : sequence of pairs of int
        Cameras that keep their pose to each other.
    """
    now = list(states)
    for _ in range(_PEOPLE_ROUNDS):
        now = _round(now, floors, fixed, people, (), 0.0)[0]
    pairs = pair_surfaces(surfaces)
    for reach in _REACHES_M if pairs else ():
        now = _round(now, floors, fixed, people, pairs, reach)[0]
    _, normal, lengths, found = _round(now, floors, fixed, people, pairs, _REACHES_M[-1])
    shared = tuple((t.a, t.b, count, mean) for t, (count, mean) in zip(pairs, found, strict=True))
    residual = float(np.median(lengths)) if len(lengths) else float("nan")
    room = _round(now, floors, fixed, (), pairs, _REACHES_M[-1])[1].matrix
    return Solution(tuple(now), _inverse(normal.matrix), _inverse(room), residual, shared)


def _round(
    states: Sequence[CameraState],
    floors: Sequence[Floor],
    fixed: Sequence[tuple[int, int]],
    people: Sequence[PeopleTerm],
    surfaces: Sequence[SurfaceTerm],
    reach_m: float,
) -> tuple[list[CameraState], Normal, Array, list[tuple[int, float]]]:
    normal = Normal(len(states))
    add_priors(normal, states, floors)
    add_fixed(normal, fixed)
    lengths = add_people(normal, states, people)
    found = add_surfaces(normal, states, surfaces, reach_m)
    normal.matrix += _UNKNOWN * np.eye(len(normal.matrix))
    steps = normal.step()
    return [s.moved(step) for s, step in zip(states, steps, strict=True)], normal, lengths, found


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix))


def moved_covariance(covariance: Array, camera: int, point: Array) -> Array:
    """Return the covariance (3, 3), m^2, of a point under a camera's pose error relative to the first one."""
    x, y, z = point
    J = np.hstack([-cross_matrix(x, y, z), np.eye(3)])
    return np.asarray(J @ _relative(covariance, camera) @ J.T)


def turned_deviation(covariance: Array, camera: int) -> float:
    """Return the standard deviation of a camera's orientation relative to the first one's, radians."""
    return float(np.sqrt(np.trace(_relative(covariance, camera)[:3, :3])))


def _relative(C: Array, camera: int) -> Array:
    first, other = slice(0, 6), slice(camera * SIZE, camera * SIZE + 6)
    return np.asarray(C[first, first] + C[other, other] - C[first, other] - C[other, first])
