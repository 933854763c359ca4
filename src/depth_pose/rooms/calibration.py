"""Where the cameras of one room stand, from people who walk about in it.

`RoomCalibration` collects what each camera saw; `solve` finds the cameras. The floor of each gives tilt and
height; people whom two cameras see at the same time give the rest (`depth_pose.rooms.calibration_match`);
then all cameras are refined together, on people, floors and the surfaces of the empty room
(`depth_pose.rooms.calibration_solve`).

The room frame: z up, the floor at z = 0, the origin below the first camera, x along its view; metres.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.core.types import Skeleton
from depth_pose.detect.floor import Floor
from depth_pose.rooms.background import RoomSurface, find_surface
from depth_pose.rooms.calibration_checks import check_match, check_records, check_solution, check_ties
from depth_pose.rooms.calibration_floor import find_floor
from depth_pose.rooms.calibration_input import BodyTrack, CameraRecord
from depth_pose.rooms.calibration_match import level_walk, match_pair
from depth_pose.rooms.calibration_solve import Solution, relative_spread, solve_room
from depth_pose.rooms.calibration_terms import CameraState, PeopleTerm
from depth_pose.rooms.rig import RigCamera
from depth_pose.rooms.rigfile import Rig, upright_from
from depth_pose.rooms.transform_tree import TransformTree

Array = NDArray[np.float64]

_TRUNK = [JOINT_INDEX[name] for name in ("pelvis", "spine", "chest", "neck", "head")]
_SAME_TRACK_M, _SAME_TRACK_S = 0.3, 1.0
"""Tracks of one person lie within this (m, median of the trunk) for at least this time (s). Set by hand."""


@dataclass(frozen=True)
class PairQuality:
    """How well two cameras are tied to each other.

    Attributes
    ----------
    first, second : str
        Names of the cameras.
    seconds : float
        People's time seen by both, seconds.
    overlap : float
        Share of the people's time of both cameras that both saw.
    points : int
        Points of the empty room that both see.
    source : str
        What ties them: ``people``, ``the empty room``, both, or ``/tf_static``.
    """

    first: str
    second: str
    seconds: float
    overlap: float
    points: int
    source: str


@dataclass(frozen=True)
class Calibration:
    """Where the cameras stand.

    Attributes
    ----------
    records : tuple of CameraRecord
        The cameras, in their order.
    T_room_camera : (C, 4, 4) float64
        Optical frame to the room frame: z up, floor z = 0, origin below the first camera, x along its view.
    offsets : (C,) float64
        Clock of each camera minus that of the first, seconds.
    deviation_m, deviation_deg : (C,) float64
        Estimated deviation of each camera against the first: of places where people were, and of its turn.
    pairs : tuple of PairQuality
    residual : float
        Median distance of joints that two cameras see, metres.
    """

    records: tuple[CameraRecord, ...]
    T_room_camera: Array
    offsets: Array
    deviation_m: Array
    deviation_deg: Array
    pairs: tuple[PairQuality, ...]
    residual: float

    def places(self, camera: int) -> list[Array]:
        """Return where people's pelvises were by one camera, (N, 3) for each track, room frame, metres."""
        T = self.T_room_camera[camera]
        return [t.joints[:, 0] @ T[:3, :3].T + T[:3, 3] for t in self.records[camera].tracks(0)]

    def surface(self, camera: int) -> Array:
        """Return the points (N, 3) of the empty room that one camera sees, room frame, metres."""
        surface, T = _surface(self.records[camera]), self.T_room_camera[camera]
        return np.zeros((0, 3)) if surface is None else surface.points @ T[:3, :3].T + T[:3, 3]

    @property
    def rig(self) -> Rig:
        """The rig; every camera needs its intrinsics."""
        T_upright_world = upright_from("z")
        cameras = []
        for record, T in zip(self.records, self.T_room_camera, strict=True):
            if record.camera is None:
                raise InputError(f"{record.name}: its CameraInfo is not known")
            cameras.append(RigCamera(record.name, record.camera, np.linalg.inv(T_upright_world @ T)))
        topics = tuple(record.topic for record in self.records)
        frames = tuple(record.frame_id for record in self.records)
        return Rig(tuple(cameras), topics, "z", tuple(self.offsets.tolist()), frames)


class RoomCalibration:
    """Finds where the cameras of one room stand, from what each saw.

    Parameters
    ----------
    records : sequence of CameraRecord
        One a camera; they may still grow. The first camera defines the room frame.
    transforms : TransformTree, optional
        Transforms that are known already: cameras whose optical frames it connects keep them.
    """

    def __init__(self, records: Sequence[CameraRecord], transforms: TransformTree | None = None) -> None:
        self.records = tuple(records)
        self._transforms = transforms or TransformTree()

    def add(self, camera: str, stamp_ns: int, skeletons: Sequence[Skeleton]) -> None:
        """Add everybody in a frame of the named camera."""
        next(r for r in self.records if r.name == camera).add(stamp_ns, skeletons)

    def solve(self) -> Calibration:
        """Find the cameras.

        Raises
        ------
        InputError
            Where they cannot be found: the reason, and what to do.
        """
        check_records(self.records)
        reference_ns = min(r.stamps_ns[0] for r in self.records)
        tracks = [record.tracks(reference_ns) for record in self.records]
        floors = [_floor(r, t) for r, t in zip(self.records, tracks, strict=True)]
        known = self._known()
        states = _chain(self._links(tracks, floors, known), floors)
        people = _people_terms(tracks, states)
        surfaces = [_surface(record) for record in self.records]
        solution = solve_room(states, floors, people, surfaces, tuple(known))
        check_solution(self.records, solution.states)
        return _result(self.records, tracks, people, solution, known)

    def _known(self) -> dict[tuple[int, int], Array]:
        """Return the known transforms between cameras, optical frame of the second to that of the first."""
        known = {}
        for (a, first), (b, second) in combinations(enumerate(self.records), 2):
            if first.frame_id and second.frame_id and first.frame_id != second.frame_id:
                T_a_b = self._transforms.find(first.frame_id, second.frame_id)
                if T_a_b is not None:
                    known[a, b] = T_a_b
        return known

    def _links(
        self,
        tracks: Sequence[Sequence[BodyTrack]],
        floors: Sequence[Floor],
        known: Mapping[tuple[int, int], Array],
    ) -> dict[tuple[int, int], _Link]:
        """Link pairs of cameras by people and known transforms, until all are connected."""
        walks = [
            [w for track in some if (w := level_walk(track, floor.T_floor_camera)) is not None]
            for some, floor in zip(tracks, floors, strict=True)
        ]
        links: dict[tuple[int, int], _Link] = {}
        reasons: dict[tuple[int, int], str] = {}
        for a, b in combinations(range(len(self.records)), 2):
            match = match_pair(walks[a], walks[b])
            reason = check_match(self.records[a].name, self.records[b].name, match)
            if (a, b) in known:
                links[a, b] = _Link(known[a, b], 0.0 if match is None or reason else match.offset, np.inf)
            elif match is None or reason:
                reasons[a, b] = reason
            else:
                T_a_b = np.linalg.inv(floors[a].T_floor_camera) @ match.T_flooring @ floors[b].T_floor_camera
                links[a, b] = _Link(T_a_b, match.offset, match.seconds)
        reached = _reached(links)
        for b in range(1, len(self.records)):
            if b not in reached:
                raise InputError("; ".join(text for pair, text in reasons.items() if b in pair))
        return links


class _Link(NamedTuple):
    """First estimate of camera b against camera a, and the people's time (s) that it rests on."""

    T_a_b: Array
    offset: float
    seconds: float


def _reached(links: Iterable[tuple[int, int]]) -> set[int]:
    """Return the cameras that links connect with the first."""
    reached, before = {0}, set[int]()
    while reached != before:
        before = set(reached)
        reached |= {c for pair in links if reached & set(pair) for c in pair}
    return reached


def _floor(record: CameraRecord, tracks: Sequence[BodyTrack]) -> Floor:
    floor = find_floor(tracks, record.background, record.background_camera)
    if floor is None:
        raise InputError(
            f"{record.name}: neither the floor nor anybody who stands is seen, so up is not known"
        )
    return floor


def _surface(record: CameraRecord) -> RoomSurface | None:
    if record.background is None or record.background_camera is None:
        return None
    return find_surface(record.background, record.background_camera)


def _chain(links: Mapping[tuple[int, int], _Link], floors: Sequence[Floor]) -> list[CameraState]:
    """Place all cameras in the first one's floor frame, each by the best links that lead to it."""
    states = {0: CameraState(floors[0].T_floor_camera)}
    while len(states) < len(floors):
        reaching = [pair for pair in links if len(set(pair) & set(states)) == 1]
        a, b = max(reaching, key=lambda pair: links[pair].seconds)
        link = links[a, b]
        if a in states:
            states[b] = CameraState(states[a].T_room_camera @ link.T_a_b, states[a].offset + link.offset)
        else:
            T_room_a = states[b].T_room_camera @ np.linalg.inv(link.T_a_b)
            states[a] = CameraState(T_room_a, states[b].offset - link.offset)
    return [states[c] for c in range(len(floors))]


def _people_terms(tracks: Sequence[Sequence[BodyTrack]], states: Sequence[CameraState]) -> list[PeopleTerm]:
    """Find the pairs of tracks of two cameras that are one person."""
    terms = []
    for a, b in combinations(range(len(states)), 2):
        for first in tracks[a]:
            for second in tracks[b]:
                seen = second.at(first.times - states[a].offset + states[b].offset)
                if first.seconds[seen.present].sum() < _SAME_TRACK_S:
                    continue
                here = states[a].to_room(first.joints[seen.present][:, _TRUNK]).mean(axis=1)
                there = states[b].to_room(seen.joints[seen.present][:, _TRUNK]).mean(axis=1)
                if np.median(np.linalg.norm(here - there, axis=1)) < _SAME_TRACK_M:
                    terms.append(PeopleTerm(a, b, first, second))
    return terms


def _result(
    records: Sequence[CameraRecord],
    tracks: Sequence[Sequence[BodyTrack]],
    people: Sequence[PeopleTerm],
    solution: Solution,
    known: Mapping[tuple[int, int], Array],
) -> Calibration:
    T_room_camera = np.stack([s.T_room_camera for s in solution.states])
    for (a, b), T_a_b in known.items():  # exactly, not but for rounding
        T_room_camera[b] = T_room_camera[a] @ T_a_b
    T_new_room = _below(T_room_camera[0])
    middle = np.median(
        np.concatenate([solution.states[p.a].to_room(p.track_a.joints[:, 0]) for p in people]), axis=0
    )
    check_ties(
        [record.name for record in records[1:]],
        [_spread_of_places(solution.states, people, c) for c in range(1, len(records))],
        [relative_spread(solution.covariance_by_room, c, middle)[0] for c in range(1, len(records))],
    )
    spreads = [relative_spread(solution.covariance, c, middle) for c in range(len(records))]
    return Calibration(
        records=tuple(records),
        T_room_camera=T_new_room @ T_room_camera,
        offsets=np.array([s.offset for s in solution.states]),
        deviation_m=np.array([m for m, _ in spreads]),
        deviation_deg=np.array([d for _, d in spreads]),
        pairs=tuple(
            _quality(records, tracks, people, solution, a, b, (a, b) in known)
            for a, b in combinations(range(len(records)), 2)
        ),
        residual=solution.residual,
    )


def _spread_of_places(states: Sequence[CameraState], people: Sequence[PeopleTerm], camera: int) -> Array:
    """Deviation (2,) of the places where a camera and another saw somebody, along and across, metres."""
    places = [np.zeros((1, 2))]
    for a, b, first, second in people:
        if camera in (a, b):
            present = second.at(first.times - states[a].offset + states[b].offset).present
            places.append(states[a].to_room(first.joints[present][:, 0])[:, :2])
    rows = np.concatenate(places[1:] or places)
    rows = rows - rows.mean(axis=0)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(rows.T @ rows / len(rows)), 0.0))[::-1])


def _below(T_room_camera: Array) -> Array:
    """Return the transform to the frame with its origin below a camera, and x along its view."""
    up = T_room_camera[:3, :3].T @ [0.0, 0.0, 1.0]
    T_floor_camera = Floor(up, float(T_room_camera[2, 3])).T_floor_camera
    return np.asarray(T_floor_camera @ np.linalg.inv(T_room_camera))


def _quality(
    records: Sequence[CameraRecord],
    tracks: Sequence[Sequence[BodyTrack]],
    people: Sequence[PeopleTerm],
    solution: Solution,
    a: int,
    b: int,
    is_known: bool,
) -> PairQuality:
    both = 0.0
    for term in people:
        if (term.a, term.b) == (a, b):
            offset = solution.states[b].offset - solution.states[a].offset
            present = term.track_b.at(term.track_a.times + offset).present
            both += float(term.track_a.seconds[present].sum())
    either = sum(float(t.seconds.sum()) for c in (a, b) for t in tracks[c]) - both
    points = sum(count for i, j, count, _ in solution.surfaces if {i, j} == {a, b})
    ties = [name for name, there in (("people", both > 0), ("the empty room", points > 0)) if there]
    source = "/tf_static" if is_known else " and ".join(ties)
    return PairQuality(records[a].name, records[b].name, both, both / max(either, 1e-9), points, source)
