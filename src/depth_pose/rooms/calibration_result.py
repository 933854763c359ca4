"""The result of a calibration: the cameras' poses and their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.detect.floor import Floor
from depth_pose.rooms.background import RoomSurface
from depth_pose.rooms.calibration_checks import check_places
from depth_pose.rooms.calibration_input import BodyTrack, CameraRecord
from depth_pose.rooms.calibration_people import PeopleTerm
from depth_pose.rooms.calibration_solve import Solution, moved_covariance, turned_deviation
from depth_pose.rooms.calibration_state import CameraState
from depth_pose.rooms.rig import RigCamera
from depth_pose.rooms.rigfile import Rig, upright_from

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PairQuality:
    """Data that two cameras share.

    Attributes
    ----------
    first, second : str
        Names of the cameras.
    seconds : float
        Time of people seen by both, seconds.
    overlap : float
        Time of people seen by both cameras, as a share of that seen by either.
    points : int
        Points of the empty room that both see.
    source : str
        What connects them: ``people``, ``the empty room``, both, or ``/tf_static``.
    """

    first: str
    second: str
    seconds: float
    overlap: float
    points: int
    source: str


@dataclass(frozen=True)
class Calibration:
    """Poses of the cameras.

    Attributes
    ----------
    records : tuple of CameraRecord
        The cameras, in their order.
    T_room_camera : (C, 4, 4) float64
        Optical frame to the room frame: z up, floor z = 0, origin below the first camera, x along its view.
    offsets : (C,) float64
        Clock of each camera minus that of the first, seconds.
    deviation_m, deviation_deg : (C,) float64
        Estimated deviation of each camera relative to the first: of people's positions, and of its
        orientation.
    pairs : tuple of PairQuality
    residual : float
        Median distance of joints that two cameras see, metres.
    places : tuple of tuple of (N, 3) arrays
        Positions of the pelvis by camera and track, room frame, metres.
    surfaces : tuple of (N, 3) arrays
        Points of the empty room by each camera, room frame, metres.
    """

    records: tuple[CameraRecord, ...]
    T_room_camera: Array
    offsets: Array
    deviation_m: Array
    deviation_deg: Array
    pairs: tuple[PairQuality, ...]
    residual: float
    places: tuple[tuple[Array, ...], ...]
    surfaces: tuple[Array, ...]

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


def make_result(
    records: Sequence[CameraRecord],
    tracks: Sequence[Sequence[BodyTrack]],
    people: Sequence[PeopleTerm],
    solution: Solution,
    surfaces: Sequence[RoomSurface | None],
    known: Mapping[tuple[int, int], Array],
) -> Calibration:
    """Express a solution in the room frame of the first camera, with its quality.

    Raises
    ------
    InputError
        If too few observations connect a camera to the others.
    """
    T_room_camera = np.stack([s.T_room_camera for s in solution.states])
    for (a, b), T_a_b in known.items():  # exactly, without rounding errors
        T_room_camera[b] = T_room_camera[a] @ T_a_b
    T_new_room = _below(T_room_camera[0])
    T_room_camera = T_new_room @ T_room_camera
    spots = [_common_spots(solution.states, people, c) for c in range(len(records))]
    for c in range(1, len(records)):
        if not any(c in pair for pair in known):
            _check_tie(records[c].name, spots[c], solution.covariance_by_room, c)
    everywhere = np.concatenate(spots)
    middle = np.median(everywhere, axis=0) if len(everywhere) else solution.states[0].T_room_camera[:3, 3]
    moved = [moved_covariance(solution.covariance, c, middle) for c in range(len(records))]
    turned = [turned_deviation(solution.covariance, c) for c in range(len(records))]
    offsets = np.array([s.offset for s in solution.states])
    return Calibration(
        records=tuple(records),
        T_room_camera=T_room_camera,
        offsets=np.round(offsets - offsets[0], 6),
        deviation_m=np.array([np.sqrt(np.trace(C)) for C in moved]),
        deviation_deg=np.degrees(turned),
        pairs=tuple(
            _quality(records, tracks, people, solution, a, b, (a, b) in known)
            for a, b in combinations(range(len(records)), 2)
        ),
        residual=solution.residual,
        places=tuple(
            tuple(_moved(T, track.joints[:, 0]) for track in some)
            for T, some in zip(T_room_camera, tracks, strict=True)
        ),
        surfaces=tuple(
            np.zeros((0, 3)) if surface is None else _moved(T, surface.points)
            for T, surface in zip(T_room_camera, surfaces, strict=True)
        ),
    )


def _moved(T: Array, points: Array) -> Array:
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _common_spots(states: Sequence[CameraState], people: Sequence[PeopleTerm], camera: int) -> Array:
    """Return the positions (N, 3) of people that a camera shares with another, room frame, metres."""
    spots = [
        states[term.a].to_room(term.track_a.joints[term.agrees][:, 0])
        for term in people
        if camera in (term.a, term.b)
    ]
    return np.concatenate([np.zeros((0, 3)), *spots])


def _check_tie(name: str, spots: Array, by_room: Array, camera: int) -> None:
    """Check that the background constrains what the tracks leave undetermined.

    People on one line do not constrain the direction across it, and people in one place hardly constrain the
    rotation.
    """
    middle = spots.mean(axis=0) if len(spots) else np.zeros(3)
    flat = (spots - middle)[:, :2]
    variance, axes = np.linalg.eigh(flat.T @ flat / max(len(flat), 1))
    across, along = np.sqrt(np.maximum(variance, 0.0))
    end = 2.0 * along * np.array([*axes[:, 1], 0.0])
    aside = np.array([*axes[:, 0], 0.0])
    missing = max(
        aside @ moved_covariance(by_room, camera, place) @ aside for place in (middle + end, middle - end)
    )
    whole = np.trace(moved_covariance(by_room, camera, middle))
    check_places(name, float(along), float(across), float(np.sqrt(missing)), float(np.sqrt(whole)))


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
    both = sum(term.seconds for term in people if (term.a, term.b) == (a, b))
    either = sum(float(t.seconds.sum()) for c in (a, b) for t in tracks[c]) - both
    points = sum(count for i, j, count, _ in solution.surfaces if {i, j} == {a, b})
    ties = [name for name, there in (("people", both > 0), ("the empty room", points > 0)) if there]
    source = "/tf_static" if is_known else " and ".join(ties)
    return PairQuality(records[a].name, records[b].name, both, both / max(either, 1e-9), points, source)
