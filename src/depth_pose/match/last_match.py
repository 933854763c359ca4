"""When a person's exemplars are searched for again: not in every frame.

People move little from one frame to the next, and the refinement keeps their pose. Whoever was matched
before keeps those candidates for some frames, carried along with the person's points; searches of
several people are spread over the frames.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.types import PoseMatch
from depth_pose.track.person import Person

_LONGEST_NS = 100_000_000
"""Candidates are carried along for so long, nanoseconds: at a few frames a second people move too far. In the
corridor, 5 frames a second, a search in every second frame cost 1 to 3 points of PCK.10; at 25 and 30 frames
a second it costs nothing that can be told (docs/accuracy.md)."""


class LastMatch:
    """What was matched for one person, and when they are searched for again.

    Parameters
    ----------
    every : int
        Frames from one search to the next. The first rest may be shorter: people whose ids follow each other
        take turns.
    """

    def __init__(self, every: int) -> None:
        self._every = every
        self._age = 0
        self._match: PoseMatch | None = None
        self._stamp_ns = 0
        self._middle: NDArray[np.float64] = np.zeros(3)

    def carried(self, person: Person, scale: float) -> PoseMatch | None:
        """Give the last match, moved to where the person is; None where it is time to search.

        Parameters
        ----------
        person : Person
        scale : float
            Their size as it is known by now.
        """
        if self._match is None:
            return None
        self._age += 1
        if self._age >= self._every or person.stamp_ns - self._stamp_ns > _LONGEST_NS:
            self._age = 0
            return None
        shift = _middle(person) - self._middle
        candidates = (replace(c, translation=c.translation + shift) for c in self._match.candidates)
        return replace(self._match, scale=scale, candidates=tuple(candidates))

    def keep(self, person: Person, match: PoseMatch) -> None:
        """Keep what a search found."""
        if self._match is None:
            self._age = sum(person.body_id.encode()) % self._every
        self._match, self._stamp_ns, self._middle = match, person.stamp_ns, _middle(person)


def _middle(person: Person) -> NDArray[np.float64]:
    """Middle (3,) of a person's points, metres."""
    return np.asarray(person.points.mean(axis=0))
