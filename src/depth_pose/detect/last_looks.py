"""Who is looked at closely again, and who not yet: several people take turns.

Of somebody who was sure to be a person a moment ago, and who is where they were, the last look is carried
along. Who is alone is looked at in every frame: that costs little, and in the frames in between the joints of
somebody quick lag behind (docs/method.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.detect.finder import Detection
from depth_pose.detect.joint_finder import JointProposals

_LONGEST_NS = 100_000_000
"""A look is carried along for so long, nanoseconds, as the matcher's candidates are."""

_MOVED_M, _APART_M = 0.15, 0.4
"""Farther than this from where they were it may be somebody else, metres; and nobody else may be nearer."""

_SURE = 0.9
"""Probability of a person at which they need no new look at once; of both looks at the last one."""


@dataclass(frozen=True)
class _Look:
    """The last look at somebody: where they were, what was seen, when, and how many frames ago."""

    torso: NDArray[np.float64]
    seen: JointProposals
    stamp_ns: int
    age: int


class LastLooks:
    """What was seen of everybody in the frame before.

    Parameters
    ----------
    every : int
        Frames from one look at a person to the next.
    """

    def __init__(self, every: int) -> None:
        self._every = every
        self.reset()

    def reset(self) -> None:
        """Forget everybody."""
        self._looks: list[_Look] = []

    def renew(
        self, people: Sequence[Detection], stamp_ns: int, look: Callable[[Detection], JointProposals]
    ) -> list[JointProposals]:
        """Look at those whose turn it is, and carry along what was seen of the others.

        Parameters
        ----------
        people : sequence of Detection
            Everybody in the frame.
        stamp_ns : int
        look : callable
            Has a second look at somebody.

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
                moved = replace(before.seen, joints=before.seen.joints + (person.torso - before.torso))
                looks.append(_Look(person.torso, moved, before.stamp_ns, before.age + 1))
            else:
                # who is new rests shorter or longer, so that not all are looked at in the same frames
                age = 0 if before is not None else n % self._every
                looks.append(_Look(person.torso, look(person), stamp_ns, age))
        self._looks = looks
        return [k.seen for k in looks]

    def _before(self, person: Detection) -> _Look | None:
        """Give the last look at somebody; None where nobody, or more than one, was about there."""
        near = [k for k in self._looks if np.linalg.norm(k.torso - person.torso) < _APART_M]
        alone = len(near) == 1 and np.linalg.norm(near[0].torso - person.torso) < _MOVED_M
        return near[0] if alone else None

    def _may_rest(self, last: _Look, stamp_ns: int) -> bool:
        is_recent = 0 < stamp_ns - last.stamp_ns <= _LONGEST_NS
        return is_recent and last.age + 1 < self._every and last.seen.probability >= _SURE
