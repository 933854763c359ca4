"""Limit the number of frames in flight through the nodes.

A frame that one node has processed and the next one drops, for a newer frame, is wasted time.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

MOST = 3
"""Maximum number of frames in flight; 2 are as good on two cores, and keep fewer cores busy on more."""

LONGEST_S = 0.2
"""Seconds after which the next frame begins anyway, since an answer may never arrive."""

QUIET_S = 1.0
"""Seconds without any answer after which frames no longer wait, since the recovery node may be paused."""


class FramesInFlight:
    """Counts frames by answers' stamps, and keeps the newest waiting one; times in seconds of one clock."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Forget all frames."""
        self._stamps: deque[int] = deque(maxlen=MOST)
        self._begun_s = self._answered_s = -math.inf
        self._waiting: Any = None

    @property
    def has_waiting(self) -> bool:
        """Whether a frame waits; the next one offered replaces it."""
        return self._waiting is not None

    def offer(self, frame: Any, now_s: float) -> bool:
        """Return whether the newest frame begins now; else it waits and replaces any waiting frame."""
        self._waiting = frame if self.is_full(now_s) else None
        return self._waiting is None

    def release(self, now_s: float) -> Any:
        """Return the waiting frame if it may begin now; else None."""
        if self.is_full(now_s):
            return None
        frame, self._waiting = self._waiting, None
        return frame

    def begin(self, stamp_ns: int, now_s: float) -> None:
        """Record that a frame is in flight."""
        if self._stamps and stamp_ns <= self._stamps[-1]:  # the clock went back
            self._stamps.clear()
        self._stamps.append(stamp_ns)
        self._begun_s = now_s

    def arrive(self, stamp_ns: int, now_s: float) -> None:
        """Record that a frame was answered; earlier ones no longer will be."""
        self._answered_s = now_s
        while self._stamps and self._stamps[0] <= stamp_ns:
            self._stamps.popleft()

    def is_full(self, now_s: float) -> bool:
        """Return whether the next frame should wait."""
        waits = now_s - self._answered_s < QUIET_S and now_s - self._begun_s < LONGEST_S
        return waits and len(self._stamps) == MOST
