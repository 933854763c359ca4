"""What a stage remembers of each person, and when it forgets.

All stages keep their temporal state here, so that the rules for streams stand in one place: the
past no longer applies once stamps jump back, or ahead by more than half a second
(`depth_pose.core.stamps`), and people who were not seen for a while are forgotten.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from depth_pose.core.stamps import StampGuard

S = TypeVar("S")

MEMORY_NS = 2_000_000_000
"""Who comes back within this time, nanoseconds, is remembered: as long as recovery carries poses."""

RETURN_NS = 5_000_000_000
"""Time (ns) within which a hidden person comes back with the same id and the same build."""


class PerPerson(Generic[S]):
    """One state for each person, made when they are first asked for.

    Parameters
    ----------
    make : callable
        Makes the state of somebody new.
    memory_ns : int
        How long somebody who is not seen is remembered, nanoseconds.
    """

    def __init__(self, make: Callable[[], S], memory_ns: int = MEMORY_NS) -> None:
        self._make = make
        self._memory_ns = memory_ns
        self._guard = StampGuard()
        self.reset()

    def reset(self) -> None:
        """Forget everybody."""
        self._states: dict[str, S] = {}
        self._seen_ns: dict[str, int] = {}
        self._now_ns = 0

    def begin(self, stamp_ns: int) -> None:
        """Begin a frame: forget what no longer applies."""
        if self._guard.is_break(stamp_ns):
            self.reset()
        self._now_ns = stamp_ns
        for body_id in [b for b, seen in self._seen_ns.items() if stamp_ns - seen > self._memory_ns]:
            del self._states[body_id], self._seen_ns[body_id]

    def __getitem__(self, body_id: str) -> S:
        """State of somebody whom the frame shows."""
        self._seen_ns[body_id] = self._now_ns
        if body_id not in self._states:
            self._states[body_id] = self._make()
        return self._states[body_id]

    def get(self, body_id: str) -> S | None:
        """State of somebody, whether or not the frame shows them; None where nothing is known."""
        return self._states.get(body_id)

    def forget(self, body_id: str) -> None:
        """Forget one person."""
        self._states.pop(body_id, None)
        self._seen_ns.pop(body_id, None)
