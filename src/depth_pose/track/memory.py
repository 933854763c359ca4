"""State of each track, in one place.

This module defines the rules for streams. Everything is forgotten if stamps jump back, or ahead by more than
half a second (`depth_pose.core.stamps`). The poses of a person who was out of view that long are forgotten,
and after `MEMORY_NS` the person.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from depth_pose.core.config import MAX_STAMP_GAP_NS
from depth_pose.core.stamps import StampGuard
from depth_pose.track.person_view import FramePeople

if TYPE_CHECKING:
    from depth_pose.match.match import MatchMemory
    from depth_pose.recover.recover import RecoveryMemory
    from depth_pose.refine.kept_poses import KeptPoses
    from depth_pose.refine.personal import PersonalBuild

MEMORY_NS = 2_000_000_000
"""Time (ns) for which a person out of view is remembered."""

RETURN_NS = 5_000_000_000
"""Time (ns) within which a hidden person keeps id and build."""


@dataclass
class Subject:
    """One track; each stage fills in its own part.

    Attributes
    ----------
    match : MatchMemory or None
        Size, and the exemplars that were matched last.
    build : PersonalBuild or None
        Proportions, learned over frames.
    kept : KeptPoses or None
        Poses from which the next fit starts.
    recovery : RecoveryMemory or None
        The last good pose, and the filter on the joints.
    """

    match: MatchMemory | None = None
    build: PersonalBuild | None = None
    kept: KeptPoses | None = None
    recovery: RecoveryMemory | None = None

    def forget_pose(self) -> None:
        """Forget the person's place and pose."""
        self.kept = self.recovery = None


class Subjects:
    """All tracks by body id, shared by the stages of one process.

    Attributes
    ----------
    keeps_builds : bool
        Whether the builds of people who are forgotten are kept: ids are not given twice.
    """

    def __init__(self) -> None:
        self.keeps_builds = False
        self._guard = StampGuard()
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._subjects: dict[str, Subject] = {}
        self._seen_ns: dict[str, int] = {}

    def begin(self, people: FramePeople) -> None:
        """Begin a frame: forget expired state. Each stage calls this; only the first call has an effect."""
        now_ns = people.stamp_ns
        if self._guard.is_break(now_ns):
            self.reset()
        for body_id in [b for b, seen in self._seen_ns.items() if now_ns - seen > RETURN_NS]:
            forgotten = self._subjects.pop(body_id)
            del self._seen_ns[body_id]
            if self.keeps_builds:
                self._subjects[body_id] = Subject(build=forgotten.build)
        for person in people.persons:
            subject = self._subjects.setdefault(person.body_id, Subject())
            if now_ns - self._seen_ns.get(person.body_id, now_ns) > MAX_STAMP_GAP_NS:
                subject.forget_pose()
            self._seen_ns[person.body_id] = now_ns

    def __getitem__(self, body_id: str) -> Subject:
        """Return the track of a person in the frame."""
        return self._subjects[body_id]
