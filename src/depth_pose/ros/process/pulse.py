"""Signs of life of a forked process, in eight bytes of memory that it shares with the one that forked it.

A thread of the process counts them up, so that a long frame or a compiling kernel is no silence; a process
that was stopped (SIGSTOP), or that waits in a call which holds Python's lock, gives none.
"""

from __future__ import annotations

import mmap
import threading
import time

BEAT_S = 0.25
"""Seconds between two signs of life. Set by hand: a tenth of the patience."""

PATIENCE_S = 3.0
"""Seconds without one after which a process counts as hung.

Twenty busy programs on two cores made the longest silence 0.5 s. With the spare, which takes over in half a
second, a hung node is replaced within 5 s.
"""

_LONGEST_LOOK_S = 0.5
"""Seconds that one look can add to a silence: a machine that was itself paused proves nothing."""


class Pulse:
    """A counter in shared memory; made before the fork, counted up by the child, watched by the parent."""

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, 8)
        self._seen, self._silent_s, self._looked_s = 0, 0.0, time.monotonic()

    def start(self) -> None:
        """Count up from now on, in a thread of this process: the child."""
        threading.Thread(target=self._count, name="pulse", daemon=True).start()

    def _count(self) -> None:
        count = 0
        while True:
            count += 1
            self._memory[:] = count.to_bytes(8, "little")
            time.sleep(BEAT_S)

    def silent_s(self) -> float:
        """Seconds without a sign of life, as the parent has seen by looking often."""
        now_s, count = time.monotonic(), int.from_bytes(self._memory[:], "little")
        if count != self._seen:
            self._seen, self._silent_s = count, 0.0
        else:
            self._silent_s += min(now_s - self._looked_s, _LONGEST_LOOK_S)
        self._looked_s = now_s
        return self._silent_s
