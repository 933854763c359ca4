"""Schedule of searches: exemplars are not searched for in every frame.

People move little from one frame to the next, and the refinement keeps their pose. A matched person keeps the
candidates for some frames, moved along with the person's points. Searches for several people are spread over
the frames.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.types import PoseMatch
from depth_pose.track.person_view import PersonView

_LONGEST_NS = 100_000_000
"""Maximum age (ns) of carried candidates; at 5 frames a second, longer costs 1 to 3 points of PCK.10."""


class LastMatch:
    """The last match of one person, and the time of the next search.

    Parameters
    ----------
    every : int
        Frames from one search to the next. The first interval may be shorter, so that people with consecutive
        ids take turns.
    """

    def __init__(self, every: int) -> None:
        self._every = every
        self._age = 0
        self._match: PoseMatch | None = None
        self._stamp_ns = 0
        self._middle: NDArray[np.float64] = np.zeros(3)

    def carried(self, person: PersonView, scale: float) -> PoseMatch | None:
        """Return the last match, moved with the person; None when a search is due.

        Parameters
        ----------
        person : PersonView
        scale : float
            Current estimate of the size.
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

    def keep(self, person: PersonView, match: PoseMatch) -> None:
        """Store the result of a search."""
        if self._match is None:
            self._age = sum(person.body_id.encode()) % self._every
        self._match, self._stamp_ns, self._middle = match, person.stamp_ns, _middle(person)


def _middle(person: PersonView) -> NDArray[np.float64]:
    """Compute the mean (3,) of a person's points, metres."""
    return np.asarray(person.points.mean(axis=0))
