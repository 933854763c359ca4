"""Schedule of second looks: several people take turns.

The last look is reused for a person who was confirmed a moment ago and has not moved away. A single person is
examined in every frame: that costs little, and reused joints lag behind fast motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.detect.finder import Detection
from depth_pose.detect.joint_finder import JointProposals

_LONGEST_NS = 100_000_000
"""Maximum age (ns) of a reused look, the same as for the matcher's candidates."""

_MOVED_M, _APART_M = 0.15, 0.4
"""Maximum movement (m) of the same person, and least distance (m) of another person."""

_SURE = 0.9
"""Least person probability of both looks for reusing the last one."""


@dataclass(frozen=True)
class _Look:
    """The last look at a person: place, result, stamp, and age in frames."""

    torso: NDArray[np.float64]
    seen: JointProposals
    stamp_ns: int
    age: int


class LastLooks:
    """Last looks at the people of the previous frame.

    Parameters
    ----------
    every : int
        Frames from one look at a person to the next.
    """

    def __init__(self, every: int) -> None:
        self._every = every
        self.reset()

    def reset(self) -> None:
        """Forget all people."""
        self._looks: list[_Look] = []

    def renew(
        self, people: Sequence[Detection], stamp_ns: int, look: Callable[[Detection], JointProposals]
    ) -> list[JointProposals]:
        """Examine the people whose turn it is, and reuse the last looks of the others.

        Parameters
        ----------
        people : sequence of Detection
            All people in the frame.
        stamp_ns : int
        look : callable
            Examines one person.

        Returns
        -------
        list of JointProposals
            One for each of ``people``.
        """
        looks = []
        are_several = sum(k.seen.probability >= _SURE for k in self._looks) > 1
        for n, person in enumerate(people):
            before = self._before(person)
            if before is not None and are_several and self._may_rest(before, stamp_ns):
                moved = before.seen.moved(person.torso - before.torso)
                looks.append(_Look(person.torso, moved, before.stamp_ns, before.age + 1))
            else:
                # the first interval varies, so that not all people are examined in the same frames
                age = 0 if before is not None else n % self._every
                looks.append(_Look(person.torso, look(person), stamp_ns, age))
        self._looks = looks
        return [k.seen for k in looks]

    def _before(self, person: Detection) -> _Look | None:
        """Return the last look at a person; None if no one, or more than one, was near that place."""
        near = [k for k in self._looks if np.linalg.norm(k.torso - person.torso) < _APART_M]
        alone = len(near) == 1 and np.linalg.norm(near[0].torso - person.torso) < _MOVED_M
        return near[0] if alone else None

    def _may_rest(self, last: _Look, stamp_ns: int) -> bool:
        is_recent = 0 < stamp_ns - last.stamp_ns <= _LONGEST_NS
        return is_recent and last.age + 1 < self._every and last.seen.probability >= _SURE
