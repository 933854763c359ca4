"""Whether Fast DDS still works in this process: its timers can lock each other out for good.

Where the timer that watches over another process falls due while that process says goodbye, the thread of the
timers and the thread that receives wait for each other (eProsima/Fast-DDS, issue 6502, open). From then on
nothing is received, and nobody else notices: the process itself lives.
"""

from __future__ import annotations

import contextlib
import os

_TIMERS = "dds.ev."
"""How the names of these threads begin, one for each participant."""

_TASKS = "/proc/self/task"


class StandstillWatch:
    """Asks Linux whether the timers' threads run.

    Parameters
    ----------
    looks : int
        Looks in a row without a sign of one of them, after which it counts as locked out.
    """

    def __init__(self, looks: int) -> None:
        self._looks = looks
        self._seen: dict[str, tuple[int, int]] = {}

    def look(self) -> bool:
        """Look once; gives whether Fast DDS stands still."""
        seen = {}
        for task in os.listdir(_TASKS):
            with contextlib.suppress(OSError):  # it has ended
                if _read(task, "comm").startswith(_TIMERS):
                    wakes, sleeps = _wakes(task)
                    before, idle = self._seen.get(task, (-1, 0))
                    seen[task] = (wakes, idle + 1 if sleeps and wakes == before else 0)
        self._seen = seen
        return any(idle >= self._looks for _, idle in seen.values())


def _wakes(task: str) -> tuple[int, bool]:
    """Say how often a thread has gone to sleep, and whether it sleeps now."""
    status = dict(line.split(":", 1) for line in _read(task, "status").splitlines())
    return int(status["voluntary_ctxt_switches"]), status["State"].strip().startswith("S")


def _read(task: str, what: str) -> str:
    with open(f"{_TASKS}/{task}/{what}") as file:
        return file.read()
