"""Several cameras that see one room: everybody's skeleton in the room's frame.

Each camera's people are linked to the people of the room (`depth_pose.rooms.tracks`). One body is fitted to
the points of all cameras that see a person (`depth_pose.rooms.room_refiner`); with a single camera, its
answer is transformed to the room's frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import BodyPose
from depth_pose.core.config import MAX_STAMP_GAP_NS, PipelineConfig
from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.recover.smooth import low_pass, with_motion
from depth_pose.rooms.camera_frame import CameraFrame
from depth_pose.rooms.clock_course import ClockCourse
from depth_pose.rooms.merge import place
from depth_pose.rooms.rig import ROOM_FRAME
from depth_pose.rooms.rigfile import Rig
from depth_pose.rooms.room_refiner import Answer, RoomMemory, RoomRefiner
from depth_pose.rooms.sightings import RoomSighting
from depth_pose.rooms.tracks import FORGET_NS, RoomTracks
from depth_pose.rooms.view import view_at
from depth_pose.track.follow import Follower
from depth_pose.track.packed_people import unpack_people
from depth_pose.track.person_view import PersonView

_FRESH_NS, _LATE = 150_000_000, 1.2
"""A camera's frame takes part up to this age (ns), or this many of its frame periods; set by hand."""


@dataclass(frozen=True)
class RoomResult:
    """Everybody in the room at one time, and the followed person."""

    skeletons: tuple[Skeleton, ...]
    skeleton: Skeleton


@dataclass(frozen=True)
class _Seen:
    """A person in a camera's newest frame; pose and skeleton are in the camera's frame."""

    camera: int
    stamp_ns: int
    person: PersonView
    pose: BodyPose
    skeleton: Skeleton


class RoomFusion:
    """Fuses the answers of several cameras to skeletons in the room's frame.

    Parameters
    ----------
    bank : Bank
    rig : Rig
        The cameras' poses.
    config : PipelineConfig

    Attributes
    ----------
    fitted : int
        Number of people in the last answer who were fitted to several cameras.
    clocks : sequence of ClockCourse
        How much each camera's stamps are too large, beyond the rig's offset; nothing unless set.
    """

    def __init__(self, bank: Bank, rig: Rig, config: PipelineConfig = PipelineConfig()) -> None:
        self.rig = rig
        self.clocks: Sequence[ClockCourse] = [ClockCourse()] * len(rig.cameras)
        self._places = [camera.T_room_camera for camera in rig.cameras]
        self._smooth = config.smooth
        self._refiner = RoomRefiner(bank, config)
        self._follower = Follower(config.follow)
        self._tracks = RoomTracks()
        self.reset()

    def reset(self) -> None:
        """Forget all earlier frames."""
        self._follower.reset()
        self._tracks.reset()
        self._newest: dict[int, tuple[int, int, Mapping[str, _Seen]]] = {}
        self._memories: dict[str, RoomMemory] = {}
        self.fitted = 0

    def room_stamp(self, camera: int, stamp_ns: int) -> int:
        """Return a camera's stamp in the clock of the first one."""
        offset_s = self.rig.clock_offsets[camera] + self.clocks[camera].offset_s(stamp_ns)
        return stamp_ns - round(offset_s * 1e9)

    def take(self, camera: int, frame: CameraFrame) -> None:
        """Add a camera's frame and link its people; frames must be in the order of their room stamps.

        Raises
        ------
        InputError
            Where the image is not of the rig's size.
        """
        c = self.rig.cameras[camera]
        if frame.size != (c.camera.width, c.camera.height):
            raise InputError(
                f"the images of {c.name} are {frame.size[0]} x {frame.size[1]}; in the rig they are "
                f"{c.camera.width} x {c.camera.height}"
            )
        stamp_ns = self.room_stamp(camera, frame.stamp_ns)
        persons = {p.body_id: p for p in unpack_people(frame.people).persons}
        known = [s for s in frame.skeletons if s.body_id in persons and s.body_id in frame.poses]
        sightings = [RoomSighting.of(place(s, self._places[camera], ROOM_FRAME)) for s in known]
        ids = self._tracks.assign(camera, stamp_ns, sightings)
        people = {
            room_id: _Seen(camera, stamp_ns, persons[s.body_id], frame.poses[s.body_id], s)
            for room_id, s in zip(ids, known, strict=True)
        }
        before_ns = self._newest[camera][0] if camera in self._newest else stamp_ns
        period_ns = min(stamp_ns - before_ns, MAX_STAMP_GAP_NS)
        self._newest[camera] = stamp_ns, max(_FRESH_NS, round(_LATE * period_ns)), people

    def answer(self, stamp_ns: int) -> RoomResult:
        """Compute the skeletons of everybody seen recently.

        Parameters
        ----------
        stamp_ns : int
            Of the answer, in the clock of the first camera; at or after all frames taken.
        """
        seen: dict[str, list[_Seen]] = {}
        for _, (at_ns, longest_ns, people) in sorted(self._newest.items()):
            if 0 <= stamp_ns - at_ns <= longest_ns:
                for room_id, one in people.items():
                    room_id = self._tracks.same.get(room_id, room_id)
                    person = self._tracks.person(room_id)
                    if person is not None and person.is_sure:
                        seen.setdefault(room_id, []).append(one)
        self._memories = {
            i: m for i, m in self._memories.items() if i in seen or stamp_ns - m.stamp_ns <= FORGET_NS
        }
        self.fitted = sum(len(views) > 1 for views in seen.values())
        skeletons = tuple(self._answer_for(i, seen[i], stamp_ns) for i in sorted(seen, key=_number))
        return RoomResult(skeletons, self._follower.choose(skeletons, stamp_ns, ROOM_FRAME))

    def _answer_for(self, room_id: str, seen: Sequence[_Seen], stamp_ns: int) -> Skeleton:
        """Compute the skeleton of one person, from one camera or from several."""
        memory = self._memories.setdefault(room_id, RoomMemory())
        person = self._tracks.person(room_id)
        assert person is not None, "a forgotten person has no view"
        answers = []
        for one in seen:
            target = self._refiner.bodies.target(one.person)
            seconds = (stamp_ns - one.stamp_ns) * 1e-9
            view = view_at(one.person, target, self._places[one.camera], person.velocity * seconds)
            answers.append(Answer(view, view.pose_in_room(one.pose), one.skeleton.joint_confidence))
        if len(answers) > 1:
            return self._refiner.refine(answers, memory, person.velocity, stamp_ns, (ROOM_FRAME, room_id))
        memory.follow(answers[0].pose, stamp_ns)
        only = place(seen[0].skeleton, answers[0].view.T_room_camera, ROOM_FRAME)
        before = memory.state.filter
        filtered = low_pass(before, only.positions, stamp_ns, self._smooth)
        memory.state = memory.state._replace(filter=filtered)
        return with_motion(replace(only, stamp_ns=stamp_ns, body_id=room_id), before, filtered)


def _number(room_id: str) -> int:
    return int(room_id.rpartition("_")[2])
