"""Calibrate the cameras of one room from people who walk about in it.

`RoomCalibration` collects each camera's observations; `solve` estimates the poses. Each camera's floor gives
its tilt and height; people seen by two cameras at the same time give the rest
(`depth_pose.rooms.calibration_match`); then all cameras are refined together, on people, floors and the
surfaces of the empty room (`depth_pose.rooms.calibration_solve`).

The room frame: z up, the floor at z = 0, the origin below the first camera, x along its view; metres.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.detect.floor import Floor
from depth_pose.rooms.background import RoomSurface, find_surface
from depth_pose.rooms.calibration_checks import check_match, check_people, check_records, check_solution
from depth_pose.rooms.calibration_floor import find_floor
from depth_pose.rooms.calibration_input import BodyTrack, CameraRecord
from depth_pose.rooms.calibration_match import match_pair
from depth_pose.rooms.calibration_people import pair_tracks
from depth_pose.rooms.calibration_result import Calibration, make_result
from depth_pose.rooms.calibration_solve import solve_room
from depth_pose.rooms.calibration_state import CameraState
from depth_pose.rooms.calibration_walks import level_walk
from depth_pose.rooms.transform_tree import TransformTree

Array = NDArray[np.float64]


class RoomCalibration:
    """Estimates the poses of the cameras of one room.

    Parameters
    ----------
    records : sequence of CameraRecord
        One per camera; they may still grow. The first camera defines the room frame.
    transforms : TransformTree, optional
        Known transforms: cameras whose optical frames they connect keep their relative pose.
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
            If the poses cannot be found; the message gives the reason and what to do.
        """
        check_records(self.records)
        known = self._known()
        reference_ns = min(r.stamps_ns[0] for r in self.records)
        tracks = [record.tracks(reference_ns) for record in self.records]
        floors = [_floor(r, t) for r, t in zip(self.records, tracks, strict=True)]
        states = _chain(self._links(tracks, floors, known), floors)
        people = pair_tracks(tracks, states)
        surfaces = [_surface(record) for record in self.records]
        solution = solve_room(states, floors, people, surfaces, tuple(known))
        check_solution(self.records, solution.states, surfaces)
        return make_result(self.records, tracks, people, solution, surfaces, known)

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
        for c, record in enumerate(self.records):
            if not any(c in pair for pair in known):
                check_people(record.name, tracks[c])
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
    """First estimate of camera b relative to camera a, and the time (s) of the people that support it."""

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
    floor = find_floor(tracks, record.background)
    if floor is None:
        raise InputError(
            f"{record.name}: neither the floor nor anybody who stands is seen, so up is not known"
        )
    return floor


def _surface(record: CameraRecord) -> RoomSurface | None:
    return None if record.background is None else find_surface(record.background)


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
