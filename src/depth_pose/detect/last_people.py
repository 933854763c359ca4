"""People who were found in the frame before, carried over to the next without a search.

People and rooms move little in a thirtieth of a second. While both looks were sure of everybody, every pixel
of the next frame belongs to whom the nearest point before belonged; what is new and goes on from somebody is
theirs. Where more is new, somebody may have come in, and the frame is searched. So it is every second frame
(`SegmentConfig.find_every`), and after each gap in the stream.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from depth_pose.core.config import SegmentConfig
from depth_pose.core.types import BACKGROUND, DepthFrame
from depth_pose.detect import _carry_kernels as kernels
from depth_pose.detect import working_grid
from depth_pose.detect._carry_kernels import Before, CarryLimits
from depth_pose.detect.candidates import Candidates
from depth_pose.detect.finder import LEAST_PIXELS, Detection
from depth_pose.detect.segmentation import Sighting

_LONGEST_NS = 50_000_000
"""Nobody is carried over a longer gap, nanoseconds: at 15 frames a second it cost 4 of 34 mm
(docs/method.md)."""

_MOVED_M, _MOVED_PIXELS = 0.1, 8
"""Farthest that a point is looked for, metres and pixels: 3 m/s at 30 frames a second. By hand, not swept."""

_SURE = 0.9
"""Least probability of everybody: a thing taken for a person is searched for again. By hand, not swept."""

_MOST_NEW = 0.02
"""Share of people's pixels that may be new: most on the development clips is .004. By hand, not swept."""


@dataclass(frozen=True)
class _Before:
    """Whom the frame before showed, and when."""

    candidates: Candidates
    stamp_ns: int


class LastPeople:
    """Whom the frame before showed.

    Parameters
    ----------
    config : SegmentConfig
    """

    def __init__(self, config: SegmentConfig) -> None:
        self._config = config
        self._limits = CarryLimits(_MOVED_M, config.depth_jump, _MOVED_PIXELS)
        self.reset()

    def reset(self) -> None:
        """Forget everybody."""
        self._before: _Before | None = None
        self._age = 0

    def carry(self, frame: DepthFrame) -> Candidates | None:
        """Find in a frame who was in the one before; None where it has to be searched."""
        self._age += 1
        carried = None if self._before is None else self._carry(self._before, frame)
        if carried is None:
            self._age = 0
        return carried

    def keep(self, candidates: Candidates, sightings: Sequence[Sighting], stamp_ns: int) -> None:
        """Keep who turned out to be a person; nobody where one of them is not sure."""
        self._before = None
        if not sightings or min(s.probability for s in sightings) < _SURE:
            return
        sure = {s.label for s in sightings}
        people = tuple(p for p in candidates.people if p.label in sure)
        labels = candidates.labels
        for thing in candidates.people:
            if thing.label not in sure:
                labels = np.where(labels == thing.label, np.uint8(BACKGROUND), labels)
        self._before = _Before(replace(candidates, labels=labels, people=people), stamp_ns)

    def _carry(self, before: _Before, frame: DepthFrame) -> Candidates | None:
        if self._age >= self._config.find_every or not 0 < frame.stamp_ns - before.stamp_ns <= _LONGEST_NS:
            return None
        was = before.candidates
        depth, camera = working_grid.reduce_frame(frame, self._config)
        if camera != was.camera:
            return None
        labels, is_new = np.empty(depth.shape, np.uint8), np.empty(depth.shape, np.bool_)
        kernels.carry_labels(Before(was.depth, was.labels), depth, camera, self._limits, labels, is_new)
        if kernels.count_inside(is_new) > _MOST_NEW * np.count_nonzero(labels):
            return None
        kernels.take_new(depth, is_new, self._limits.jump, labels)
        now = Candidates(depth, labels, camera, was.people, was.out_of_range)
        moved = [_moved(person, was, now) for person in was.people]
        return replace(now, people=tuple(p for p in moved if p is not None)) if all(moved) else None


def _moved(person: Detection, was: Candidates, now: Candidates) -> Detection | None:
    """Move somebody as the middle of their points moved; None where they are gone."""
    old, new = np.empty(3), np.empty(3)
    kernels.middle_of(was.depth, was.labels, person.label, was.camera, old)
    if kernels.middle_of(now.depth, now.labels, person.label, now.camera, new) < LEAST_PIXELS:
        return None
    return replace(person, torso=person.torso + (new - old))
