"""Who is served where time is short: in turn, so that nobody waits for long.

Live, a frame's people must be done before the next frames pile up. With a budget, people are served
until it is spent: first those who were left out of the last frame, then the nearest. Offline there is
no budget, and everybody is served.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from depth_pose.track.person import Person


class Turns:
    """Hands out the people of a frame, as long as there is time.

    Attributes
    ----------
    budget_s : float
        Time for all people of a frame, seconds; 0 for no limit.
    left_out : int
        People who were not served, over all frames.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.budget_s = 0.0
        self.left_out = 0
        self._clock = clock
        self._waiting: frozenset[str] = frozenset()

    def take(self, persons: Sequence[Person]) -> Iterator[Person]:
        """Give people one after the other; the first always, the others while there is time."""
        if self.budget_s <= 0.0:
            yield from persons
            return
        ends = self._clock() + self.budget_s
        order = sorted(persons, key=lambda p: (p.body_id not in self._waiting, np.median(p.points[:, 2])))
        served = 0
        for person in order:
            if served and self._clock() >= ends:
                break
            served += 1
            yield person
        self._waiting = frozenset(p.body_id for p in order[served:])
        self.left_out += len(self._waiting)
