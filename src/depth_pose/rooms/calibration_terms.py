"""The terms of a room's least-squares problem, linearised: people, floors and the empty room.

Unknowns of each camera, `SIZE` numbers: a small motion of its pose in the room (rotation vector, then
translation: ``q -> q + w x q + t``), its clock's offset (s), and by how much people appear too near along its
rays (m). The last is there since the joints of a body that is fitted to a surface lie up to some centimetres
too near, in either camera, which no transform explains.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from depth_pose.core.rotations import cross_matrix, rotvec_to_matrix, unit_vectors
from depth_pose.core.skeleton import JOINTS
from depth_pose.detect.floor import Floor
from depth_pose.rooms.background import RoomSurface
from depth_pose.rooms.calibration_input import BodyTrack

Array = NDArray[np.float64]

SIZE = 8
_OFFSET, _NEAR = 6, 7

_ERRORS = {
    "pelvis": (1.0, 0.03, 0.025),
    "spine": (1.6, 0.05, 0.025),
    "chest": (1.9, 0.05, 0.025),
    "neck": (1.1, 0.03, 0.025),
    "head": (0.6, 0.02, 0.03),
    "shoulder": (1.3, 0.045, 0.035),
    "elbow": (2.5, 0.08, 0.07),
    "wrist": (3.0, 0.1, 0.1),
    "hip": (0.9, 0.03, 0.03),
    "knee": (0.25, 0.02, 0.035),
    "ankle": (0.15, 0.015, 0.04),
    "foot": (0.4, 0.03, 0.06),
}
"""Errors of joints that are seen: by how much they appear too near, against the pelvis; deviation along the
ray and across it, metres. From ``python benchmarks/rooms.py joints``."""
_NEAR_SHARE, _ALONG_M, _ACROSS_M = np.array([_ERRORS[name.rpartition("_")[2]] for name in JOINTS]).T
_ALIKE_S = 0.7
"""A joint's error is the same for about this time, seconds. Set by hand."""
_MOST_S = 25.0
"""Two cameras' joints count as at most this much time: systematic errors remain, however long people walk.
Chosen on simulated pairs from 5, 15 and no limit."""
_ALIKE_JOINTS = 4.0
"""Number of joints that err alike. Set by hand."""
_FAR_M = 0.12
"""Residual (m) at which a joint has a quarter of its weight. Set by hand."""

NEAR_M, NEAR_SPREAD_M = 0.03, 0.02
"""By how much people appear too near, mean and deviation over sensors, metres."""
OFFSET_SPREAD_S = 0.3
"""Deviation of clock offsets, seconds. Set by hand."""

_UP_SPREAD, _HEIGHT_SPREAD_M = np.radians(0.5), 0.03
"""Deviation of the floor that depth images show: direction (radians), height. Set by hand."""
_ROUGH = 8.0
"""The same for a floor that is estimated from people, as a multiple. Set by hand."""

_FIXED = 1e9
"""Weight of what does not move, 1/m^2: far above all others."""

_SURFACE_M, _SURFACE_PER_M = 0.012, 0.0015
"""Deviation of the empty room's points (m), and its growth with the squared distance (1/m), as of sensors
that measure disparity. Set by hand."""
_ALIKE_POINTS = 20.0
"""Number of neighbouring points that err alike. Set by hand."""
_SAME_COS = np.cos(np.radians(35.0))
"""Normals of one surface in two cameras differ by less than this. Set by hand."""


@dataclass(frozen=True)
class CameraState:
    """The current estimate of one camera.

    Attributes
    ----------
    T_room_camera : (4, 4) float64
    offset : float
        Its clock minus the room's, seconds.
    near : float
        By how much people's pelvises appear too near along its rays, metres.
    """

    T_room_camera: Array
    offset: float = 0.0
    near: float = NEAR_M

    def to_room(self, points: Array) -> Array:
        """Points (..., 3) of the camera frame in the room frame, metres."""
        return np.asarray(points @ self.T_room_camera[:3, :3].T + self.T_room_camera[:3, 3])

    def moved(self, step: Array) -> CameraState:
        """Apply a step (SIZE,) of the unknowns."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotvec_to_matrix(step[:3]), step[3:6]
        return replace(
            self,
            T_room_camera=T @ self.T_room_camera,
            offset=self.offset + float(step[_OFFSET]),
            near=self.near + float(step[_NEAR]),
        )


class Normal:
    """Normal equations of all cameras: ``matrix`` (M, M) and ``vector`` (M,), M = `SIZE` times cameras."""

    def __init__(self, cameras: int) -> None:
        self.matrix = np.zeros((cameras * SIZE, cameras * SIZE))
        self.vector = np.zeros(cameras * SIZE)

    def add(self, rows: Sequence[tuple[int, Array]], residual: Array, weight: Array) -> None:
        """Add residuals (N,) with weights (N,), and their derivatives (N, SIZE) by cameras."""
        for a, Ja in rows:
            weighted = Ja * weight[:, None]
            self.vector[a * SIZE : (a + 1) * SIZE] += weighted.T @ residual
            for b, Jb in rows:
                self.matrix[a * SIZE : (a + 1) * SIZE, b * SIZE : (b + 1) * SIZE] += weighted.T @ Jb

    def step(self) -> Array:
        """Return the Gauss-Newton step (cameras, SIZE)."""
        return np.asarray(-np.linalg.solve(self.matrix, self.vector).reshape(-1, SIZE))


def motion_rows(points: Array) -> Array:
    """Return the derivatives (N, 3, SIZE) of points (N, 3) in the room by their camera's motion."""
    rows = np.zeros((len(points), 3, SIZE))
    x, y, z = points.T
    rows[:, :, :3] = -cross_matrix(x, y, z)
    rows[:, :, 3:6] = np.eye(3)
    return rows


class PeopleTerm(NamedTuple):
    """One person in two cameras: a track of camera ``a`` and one of camera ``b`` that agree."""

    a: int
    b: int
    track_a: BodyTrack
    track_b: BodyTrack


def add_people(normal: Normal, states: Sequence[CameraState], terms: Sequence[PeopleTerm]) -> Array:
    """Add the joints that two cameras see at the same time; return the residuals' lengths (N,), metres."""
    lengths = []
    total: defaultdict[tuple[int, int], float] = defaultdict(float)
    for term in terms:
        total[term.a, term.b] += float(term.track_a.seconds.sum())
    for a, b, track_a, track_b in terms:
        first, second = states[a], states[b]
        seen = track_b.at(track_a.times - first.offset + second.offset)
        sure = np.sqrt(track_a.confidence * seen.confidence)
        frame, joint = np.nonzero(sure > 0.1)
        if not len(frame):
            continue
        pa, pb = track_a.joints[frame, joint], seen.joints[frame, joint]
        ua, ub = unit_vectors(pa), unit_vectors(pb)
        Ra, Rb = first.T_room_camera[:3, :3], second.T_room_camera[:3, :3]
        share = _NEAR_SHARE[joint, None]
        qa, qb = first.to_room(pa + first.near * share * ua), second.to_room(pb + second.near * share * ub)
        ua, ub, vb = ua @ Ra.T, ub @ Rb.T, seen.velocities[frame, joint] @ Rb.T
        residual = qa - qb
        length = np.linalg.norm(residual, axis=1)
        lengths.append(length)
        Ja, Jb = motion_rows(qa), -motion_rows(qb)
        Ja[:, :, _OFFSET], Jb[:, :, _OFFSET] = vb, -vb
        Ja[:, :, _NEAR], Jb[:, :, _NEAR] = share * ua, -share * ub
        along, across = _ALONG_M[joint, None, None] ** 2, _ACROSS_M[joint, None, None] ** 2
        spread = (along - across) * (ua[:, :, None] * ua[:, None] + ub[:, :, None] * ub[:, None])
        spread += 2.0 * across * np.eye(3)
        root = np.swapaxes(np.linalg.cholesky(np.linalg.inv(spread)), 1, 2)
        seconds = track_a.seconds[frame]
        trust = min(1.0, _MOST_S / total[a, b]) / (1.0 + (length / _FAR_M) ** 2) ** 2
        weight = trust * sure[frame, joint] * seconds / (_ALIKE_S * _ALIKE_JOINTS)
        rows = [(a, (root @ Ja).reshape(-1, SIZE)), (b, (root @ Jb).reshape(-1, SIZE))]
        normal.add(rows, np.einsum("nij,nj->ni", root, residual).ravel(), np.repeat(weight, 3))
    return np.concatenate(lengths) if lengths else np.zeros(0)


def add_priors(normal: Normal, states: Sequence[CameraState], floors: Sequence[Floor]) -> None:
    """Add each camera's floor, the spread of clocks and nearness, and hold the first camera's place."""
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
        J[0, _OFFSET], J[1, _NEAR] = 1.0, 1.0
        residual = np.array([state.offset, state.near - NEAR_M])
        spreads = np.array([OFFSET_SPREAD_S if c else 1e-6, NEAR_SPREAD_M])
        normal.add([(c, J)], residual, 1.0 / spreads**2)
    J = np.zeros((3, SIZE))  # no turn about the vertical, no shift
    J[0, 2] = J[1, 3] = J[2, 4] = 1.0
    normal.add([(0, J)], np.zeros(3), np.full(3, _FIXED))


def add_fixed(normal: Normal, pairs: Sequence[tuple[int, int]]) -> None:
    """Let both cameras of each pair move alike, so that they keep their pose to each other."""
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


def add_surfaces(
    normal: Normal, states: Sequence[CameraState], terms: Sequence[SurfaceTerm], reach_m: float
) -> list[tuple[int, float]]:
    """Add points of a that lie near a surface of b; return the count and mean residual (m) of each term.

    Parameters
    ----------
    normal, states, terms
    reach_m : float
        Distance (m) beyond which a point has no partner; half of it halves its weight.
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
        spread = 2.0 * _SURFACE_M**2
        for points in (surface_a.points[there[good]], surface_b.points[index[there[good]]]):
            spread = spread + (_SURFACE_PER_M * np.sum(points**2, axis=1)) ** 2
        J = np.zeros((len(n), SIZE))
        J[:, :3], J[:, 3:6] = np.cross(qa, n), n
        weight = (1.0 - (residual / reach_m) ** 2) ** 2 / (spread * _ALIKE_POINTS)
        normal.add([(a, J), (b, -J)], residual, weight)
        found.append((len(n), float(np.abs(residual).mean())))
    return found
