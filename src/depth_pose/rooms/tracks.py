"""Tracking over several cameras: every person in the room has one id.

Each camera's own tracker gives ids to its people; here those ids are linked to the people of the room, with
the largest sum of gains (`depth_pose.rooms.room_person`). A person without a link is new. Two people of the
room at one position for a while, whom no camera sees side by side, are merged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations

from depth_pose.rooms.room_person import FRESH_NS, RoomPerson
from depth_pose.rooms.sightings import RoomSighting
from depth_pose.track.tracks import best_pairs

FORGET_NS = 10_000_000_000
"""Time (ns) after which a person that no camera sees is forgotten."""

_MOST_PEOPLE = 100
"""Maximum number of people who are remembered; set by hand."""

_BACK_NS = 1_000_000_000
"""A jump back of a camera's stamps by more than this (ns) begins a new session; set by hand."""

_JUMP_M = 1.5
"""Maximum distance (m) at which a moved camera suddenly sees the same person; set by hand."""

_ONE_PERSON = ((0.3, 0.5), (0.5, 2.0))
"""Two people closer than this distance (m) for this time (s), never seen side by side, are merged; set by
hand."""


class RoomTracks:
    """Links the people of all cameras to people of the room, and keeps the ids over time.

    Attributes
    ----------
    people : list of RoomPerson
        All who are remembered, older ones first.
    same : dict of str to str
        Ids of merged people: from the younger id to the older one.
    """

    def __init__(self) -> None:
        self._count = 0
        self.reset()

    def reset(self) -> None:
        """Forget everybody; ids are not used again."""
        self.people: list[RoomPerson] = []
        self.same: dict[str, str] = {}
        self._near: dict[tuple[int, int, float], int] = {}
        self._newest_ns = 0
        self._newest_of: dict[int, int] = {}

    def person(self, room_id: str) -> RoomPerson | None:
        """Return the person with an id; None if there is none."""
        return next((p for p in self.people if p.room_id == room_id), None)

    def assign(self, camera: int, stamp_ns: int, people: Sequence[RoomSighting]) -> tuple[str, ...]:
        """Link the people of one frame of one camera.

        Parameters
        ----------
        camera : int
            The camera's number.
        stamp_ns : int
            In the clock of camera 0. Frames of one camera come in order; those of several cameras nearly.
        people : sequence of RoomSighting
            With different ``body_id``.

        Returns
        -------
        tuple of str
            The room id of each, all different: ``person_1`` and so on.
        """
        if stamp_ns < self._newest_of.get(camera, 0) - _BACK_NS:
            self.reset()
        self._newest_of[camera] = stamp_ns
        self._newest_ns = max(self._newest_ns, stamp_ns)
        self.people = [p for p in self.people if self._newest_ns - p.seen_ns <= FORGET_NS]
        if len(self.people) > _MOST_PEOPLE:
            known = sorted(self.people, key=lambda p: (p.shared, p.seen_ns))[-_MOST_PEOPLE:]
            self.people = sorted(known, key=lambda p: p.number)
        found = self._pair(camera, stamp_ns, people)
        for k, sighting in enumerate(people):
            if k not in found:
                found[k] = self._begin(camera, stamp_ns, sighting, found)
        for k, person in found.items():
            person.see(camera, stamp_ns, people[k])
            for other in self.people:
                if other is not person and other.has(camera, people[k].body_id):
                    del other.views[camera]
        self.people = [p for p in self.people if p.views]
        merged = self._merge_doubles(stamp_ns)
        return tuple(merged.get(found[k], found[k]).room_id for k in range(len(people)))

    def leave_out(self, camera: int) -> None:
        """Forget a camera's views, and the people that only it saw."""
        for person in self.people:
            person.views.pop(camera, None)
        self.people = [p for p in self.people if p.views]

    def compare(self, camera: int, stamp_ns: int) -> list[float]:
        """Return the distances (m) of the people of a camera's newest frame from where others see them.

        If only this camera sees people, those that suddenly appeared elsewhere are compared with the people
        that they were split from.
        """
        mine = [(p, p.views[camera].sighting) for p in self.people if p.is_in(camera, stamp_ns)]
        before = [(p.split_from, sighting) for p, sighting in mine if p.split_from is not None]
        for pairs in (mine, before):
            shared = [(p, sighting) for p, sighting in pairs if p.fresh(stamp_ns, without=camera)]
            if shared:
                return [self._apart(p, sighting, camera, stamp_ns) for p, sighting in shared]
        return []

    def compare_nearest(self, camera: int, stamp_ns: int, people: Sequence[RoomSighting]) -> list[float]:
        """Return the distances (m) of an excluded camera's people from the nearest that others see."""
        seen = [p for p in self.people if p.fresh(stamp_ns, without=camera)]
        pairs = [[self._apart(p, sighting, camera, stamp_ns) for p in seen] for sighting in people]
        return [min(each) for each in pairs if each]

    @staticmethod
    def _apart(person: RoomPerson, sighting: RoomSighting, camera: int, stamp_ns: int) -> float:
        """Return the horizontal distance (m) of a sighting from the nearest view by another camera."""
        views = person.fresh(stamp_ns, without=camera)
        ways = [v.sighting.shift_to(sighting) - person.offset(v, stamp_ns) for v in views]
        return min(math.hypot(way[0], way[1]) for way in ways)

    def _begin(
        self, camera: int, stamp_ns: int, sighting: RoomSighting, found: Mapping[int, RoomPerson]
    ) -> RoomPerson:
        """Start a new person; remember whom the camera saw nearby a moment ago and has lost."""
        here = [
            p
            for p in self.people
            if camera in p.views
            and p not in found.values()
            and 0 < stamp_ns - p.views[camera].stamp_ns <= FRESH_NS
            and p.distance(sighting, [p.views[camera]], stamp_ns) < _JUMP_M
        ]
        same = [p for p in here if p.has(camera, sighting.body_id)] or here
        self._count += 1
        person = RoomPerson(self._count, split_from=same[0] if same else None)
        self.people.append(person)
        return person

    def _pair(self, camera: int, stamp_ns: int, people: Sequence[RoomSighting]) -> dict[int, RoomPerson]:
        """Pair sightings, by index, with people of the room at the largest sum of gains."""
        if not self.people or not people:
            return {}
        gains = {
            (i, k): gain
            for i, person in enumerate(self.people)
            for k, sighting in enumerate(people)
            if (gain := person.gain(camera, stamp_ns, sighting)) > 0.0
        }
        return {k: self.people[i] for i, k in best_pairs(gains, len(self.people), len(people))}

    def _merge_doubles(self, stamp_ns: int) -> dict[RoomPerson, RoomPerson]:
        """Merge two people at one position; return the younger and the older."""
        merged: dict[RoomPerson, RoomPerson] = {}
        for old, young in combinations(self.people, 2):
            if old not in merged and young not in merged and self._are_one(old, young, stamp_ns):
                merged[young] = old
        for young, old in merged.items():
            for camera, view in young.views.items():
                if camera not in old.views or view.stamp_ns >= old.views[camera].stamp_ns:
                    old.views[camera] = view
            self.same[young.room_id] = old.room_id
            self.people.remove(young)
            self._near = {k: v for k, v in self._near.items() if young.number not in k[:2]}
        return merged

    def _are_one(self, old: RoomPerson, young: RoomPerson, stamp_ns: int) -> bool:
        """Whether two people shared one position for long enough, and no camera sees both side by side."""
        views, others = young.fresh(stamp_ns), old.fresh(stamp_ns)
        together = old.sees_with(young, stamp_ns)
        distance = math.inf
        if views and others and not together:
            newest = max(views, key=lambda v: v.stamp_ns)
            distance = old.distance(newest.sighting, others, newest.stamp_ns)
        for limit, seconds in _ONE_PERSON:
            key = (old.number, young.number, limit)
            if distance > limit:
                self._near.pop(key, None)
            elif stamp_ns - self._near.setdefault(key, stamp_ns) >= seconds * 1e9:
                return True
        return False
