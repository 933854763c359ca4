"""Time budget: which people are processed when time is short.

In live use, the people of a frame must be processed before the next frames accumulate. With a budget, people
are processed until it is spent: first those skipped in the last frame, then the nearest. Offline there is no
budget, and all people are processed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from depth_pose.track.person_view import PersonView


class TimeBudget:
    """Yields the people of a frame while there is time.

    Attributes
    ----------
    limit_s : float
        Time for all people of a frame, seconds; 0 for no limit.
    left_out : int
        Number of people skipped, over all frames.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.limit_s = 0.0
        self.left_out = 0
        self._clock = clock
        self._waiting: frozenset[str] = frozenset()

    def take(self, persons: Sequence[PersonView]) -> Iterator[PersonView]:
        """Yield people one by one: always the first, the others while there is time."""
        if self.limit_s <= 0.0:
            yield from persons
            return
        ends = self._clock() + self.limit_s
        order = sorted(persons, key=lambda p: (p.body_id not in self._waiting, np.median(p.points[:, 2])))
        served = 0
        for person in order:
            if served and self._clock() >= ends:
                break
            served += 1
            yield person
        self._waiting = frozenset(p.body_id for p in order[served:])
        self.left_out += len(self._waiting)
