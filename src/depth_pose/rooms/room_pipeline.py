"""Several cameras that see one room: everybody's skeleton in the room's frame.

Each camera has a pipeline of its own. Its people are linked to the people of the room
(`depth_pose.rooms.tracks`); whom several cameras see, one body is fitted to all their points
(`depth_pose.rooms.room_refiner`), and whom one camera sees, its answer is moved to the room's frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import Fitted
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix
from depth_pose.core.types import DepthFrame, Skeleton
from depth_pose.pipeline import PosePipeline
from depth_pose.recover.smooth import JointFilter
from depth_pose.rooms.rigfile import Rig, upright_from
from depth_pose.rooms.room_refiner import Answer, RoomMemory, RoomRefiner
from depth_pose.rooms.sightings import RoomSighting
from depth_pose.rooms.tracks import FORGET_NS, RoomTracks
from depth_pose.rooms.view import view_at
from depth_pose.track.follow import Follower
from depth_pose.track.person import Person

ROOM_FRAME = "room"
"""Name of the room's frame: z up, the floor at z = 0."""

_FRESH_NS = 150_000_000
"""Maximum age (ns) of a camera's frame that takes part; set by hand."""

_SILENT = 2.5
"""Frame periods of the leading camera without a frame after which the others' frames are answered."""


@dataclass(frozen=True)
class RoomResult:
    """Everybody in the room at one time, and who is followed, as of other methods."""

    skeletons: tuple[Skeleton, ...]
    skeleton: Skeleton


@dataclass(frozen=True)
class _Seen:
    """A person in a camera's newest frame."""

    person: Person
    fitted: Fitted
    skeleton: Skeleton


@dataclass(frozen=True)
class _Newest:
    """A camera's newest frame: its people by their room ids."""

    stamp_ns: int
    people: Mapping[str, _Seen]


class RoomPipeline:
    """The pipeline from the depth frames of several cameras to skeletons in the room's frame.

    Parameters
    ----------
    bank : Bank
    rig : Rig
        Where the cameras stand.
    config : PipelineConfig
    period_ns : int
        Frame period of the leading camera, whose frames are answered.
    leader : int
        Its number in the rig.
    """

    def __init__(
        self,
        bank: Bank,
        rig: Rig,
        config: PipelineConfig = PipelineConfig(),  # noqa: B008
        *,
        period_ns: int = 33_333_333,
        leader: int = 0,
    ) -> None:
        self.cameras = [PosePipeline(bank, config) for _ in rig.cameras]
        self._rig, self._leader, self._period_ns = rig, leader, period_ns
        self._places = [camera.T_camera_world @ upright_from("z") for camera in rig.cameras]
        self._smooth = config.smooth
        self._refiner = RoomRefiner(bank, config)
        self._follower = Follower(config.follow)
        self._tracks = RoomTracks()
        self.reset()

    def reset(self) -> None:
        """Forget all earlier frames."""
        for camera in self.cameras:
            camera.reset()
        self._follower.reset()
        self._tracks.reset()
        self._newest: dict[int, _Newest] = {}
        self._memories: dict[str, RoomMemory] = {}
        self._answered_ns: int | None = None

    def warm_up(self) -> None:
        """Compile every kernel."""
        for camera in self.cameras:
            camera.warm_up()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the frames since the last reset, one line each."""
        return tuple(
            f"{rig.name}: {line}"
            for rig, camera in zip(self._rig.cameras, self.cameras, strict=True)
            for line in camera.warnings
        )

    def room_stamp(self, camera: int, stamp_ns: int) -> int:
        """Return a camera's stamp in the clock of the first one."""
        return stamp_ns - round(self._rig.clock_offsets[camera] * 1e9)

    def process_frame(self, camera: int, frame: DepthFrame) -> RoomResult | None:
        """Take a camera's frame; frames of all cameras come in the order of their room stamps.

        Returns
        -------
        RoomResult or None
            None where the frame is not answered: another camera leads.
        """
        self._rig.cameras[camera].check_size(*frame.depth.shape)
        stamp_ns = self.room_stamp(camera, frame.stamp_ns)
        self._newest[camera] = self._take(camera, stamp_ns, frame)
        is_due = self._answered_ns is None or abs(stamp_ns - self._answered_ns) > _SILENT * self._period_ns
        if camera != self._leader and not is_due:
            return None
        self._answered_ns = stamp_ns
        skeletons = self._answer(stamp_ns)
        return RoomResult(skeletons, self._follower.choose(skeletons, stamp_ns, ROOM_FRAME))

    def _take(self, camera: int, stamp_ns: int, frame: DepthFrame) -> _Newest:
        """Run a camera's own pipeline, and link its people to those of the room."""
        result = self.cameras[camera].process_frame(frame)
        persons = {p.body_id: p for p in result.people.persons}
        fitted = {f.body_id: f for f in result.refined if not f.is_lost}
        T = self._places[camera]
        known = [s for s in result.skeletons if s.body_id in persons and s.body_id in fitted]
        ids = self._tracks.assign(camera, stamp_ns, [RoomSighting.of(in_room(s, T)) for s in known])
        people = {
            room_id: _Seen(persons[s.body_id], fitted[s.body_id], s)
            for room_id, s in zip(ids, known, strict=True)
        }
        return _Newest(stamp_ns, people)

    def _answer(self, stamp_ns: int) -> tuple[Skeleton, ...]:
        """Answer for everybody whom a camera has seen a moment ago."""
        newest = {c: n for c, n in self._newest.items() if 0 <= stamp_ns - n.stamp_ns <= _FRESH_NS}
        seen: dict[str, list[tuple[int, int, _Seen]]] = {}
        for camera, frame in sorted(newest.items()):
            for room_id, one in frame.people.items():
                room_id = self._tracks.same.get(room_id, room_id)
                seen.setdefault(room_id, []).append((camera, frame.stamp_ns, one))
        self._memories = {
            i: m for i, m in self._memories.items() if i in seen or stamp_ns - m.stamp_ns <= FORGET_NS
        }
        return tuple(self._answer_for(i, seen[i], stamp_ns) for i in sorted(seen, key=_number))

    def _answer_for(self, room_id: str, seen: Sequence[tuple[int, int, _Seen]], stamp_ns: int) -> Skeleton:
        """Answer for one person, from one camera or from several."""
        if room_id not in self._memories:
            self._memories[room_id] = RoomMemory(JointFilter(self._smooth))
        memory = self._memories[room_id]
        person = self._tracks.person(room_id)
        velocity = np.zeros(3) if person is None else person.velocity
        answers = []
        for camera, at_ns, one in seen:
            target = self._refiner.bodies.target(one.person)
            seconds = (stamp_ns - at_ns) * 1e-9
            view = view_at(one.person, target, self._places[camera], velocity, seconds)
            answers.append(Answer(view, view.pose_in_room(one.fitted.pose), one.skeleton.joint_confidence))
        if len(answers) > 1:
            return self._refiner.refine(answers, memory, velocity, stamp_ns, (ROOM_FRAME, room_id))
        memory.kept.beam, memory.stamp_ns = (answers[0].pose,), stamp_ns
        only = in_room(seen[0][2].skeleton, answers[0].view.T_camera_room)
        return replace(
            only,
            stamp_ns=stamp_ns,
            body_id=room_id,
            positions=memory.filter.filter(only.positions, stamp_ns),
        )


def in_room(skeleton: Skeleton, T_camera_room: NDArray[np.float64]) -> Skeleton:
    """Return a camera's skeleton in the room's frame.

    Parameters
    ----------
    skeleton : Skeleton
    T_camera_room : (4, 4) float64
        Room to optical frame.
    """
    rotation, place = T_camera_room[:3, :3], T_camera_room[:3, 3]
    turned = rotation.T @ quat_to_matrix(skeleton.quats_xyzw)
    return replace(
        skeleton,
        frame_id=ROOM_FRAME,
        positions=(skeleton.positions - place) @ rotation,
        quats_xyzw=matrix_to_quat(turned),
    )


def _number(room_id: str) -> int:
    return int(room_id.rpartition("_")[2])


def check_rig(rig: Rig, recordings: int) -> None:
    """Raise ConfigError unless the rig has a camera for each recording, and at least two."""
    if len(rig.cameras) != recordings:
        raise ConfigError(
            f"the rig has {len(rig.cameras)} cameras ({', '.join(c.name for c in rig.cameras)}), and "
            f"{recordings} recordings are given: give one for each, in the order of the rig"
        )
