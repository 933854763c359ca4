"""Recorded skeletons, interpolated to any time, also in a room's frame.

`depth-pose run --rig` answers at the frames of the fastest camera, in the first camera's clock. At other
times, the frames of another camera or of a truth, each person's skeleton is interpolated between the two
answers around it. Half way between answers 133 ms apart this is 9 mm off for simulated people who walk, and
falls with the square of that time; the nearest answer is 27 mm off.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import slerp
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.io.skeleton_read import read_people
from depth_pose.rooms.rig import ROOM_FRAME

_FAR_NS = 125_000_000
"""Maximum time (ns) to the nearest answer: half the period of 4 answers a second; set by hand."""


@dataclass(frozen=True)
class RecordedPeople:
    """All skeletons of a recording.

    Attributes
    ----------
    path : Path
    frame_id : str
        Of the first message; empty where there is none.
    answers : mapping of int to tuple of Skeleton
        By stamp in nanoseconds; without lost ones.
    """

    path: Path
    frame_id: str
    answers: Mapping[int, tuple[Skeleton, ...]]

    @property
    def is_room(self) -> bool:
        """Whether the skeletons are in a room's frame."""
        return self.frame_id == ROOM_FRAME

    @cached_property
    def stamps_ns(self) -> list[int]:
        """All stamps, in order."""
        return sorted(self.answers)

    def at(self, stamp_ns: int) -> tuple[Skeleton, ...] | None:
        """Return everybody at a time; None where there is no answer within `_FAR_NS`.

        The people are those of the nearest answer; whoever is in the other one as well is interpolated.
        """
        after = bisect_left(self.stamps_ns, stamp_ns)
        around = self.stamps_ns[max(after - 1, 0) : after + 1]
        around.sort(key=lambda stamp: abs(stamp - stamp_ns))
        if not around or abs(around[0] - stamp_ns) > _FAR_NS:
            return None
        near, far = around[0], around[-1]
        others = {s.body_id: s for s in self.answers[far]} if abs(far - near) <= 2 * _FAR_NS else {}
        share = (stamp_ns - near) / (far - near) if far != near else 0.0
        return tuple(
            replace(_between(one, others.get(one.body_id, one), share), stamp_ns=stamp_ns)
            for one in self.answers[near]
        )


def _between(near: Skeleton, far: Skeleton, share: float) -> Skeleton:
    """Return the nearer skeleton, moved by a share of the way to the other."""
    if share == 0.0 or far is near:
        return near
    return replace(
        near,
        positions=near.positions + share * (far.positions - near.positions),
        quats_xyzw=slerp(near.quats_xyzw, far.quats_xyzw, np.array(share)),
    )


def read_recorded(path: Path | str, topic: str = PEOPLE_TOPIC) -> RecordedPeople:
    """Read all skeletons of a recording; errors as of `depth_pose.io.skeleton_read.read_people`."""
    frame_id, answers = "", dict[int, tuple[Skeleton, ...]]()
    for message in read_people(path, topic):
        frame_id = frame_id or message.frame_id
        answers[message.stamp_ns] = tuple(s for s in message.skeletons if not s.is_lost)
    return RecordedPeople(Path(path), frame_id, answers)


def has_room(path: Path | str, topic: str = PEOPLE_TOPIC) -> bool:
    """Whether a recording has skeletons, in a room's frame."""
    try:
        first = next(read_people(path, topic), None)
    except InputError:  # no skeletons
        return False
    return first is not None and first.frame_id == ROOM_FRAME
