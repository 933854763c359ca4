"""Whether Fast DDS still works in this process: its timers can lock each other out for good.

Where the timer that watches over another process falls due while that process says goodbye, the thread of the
timers and the thread that receives wait for each other (eProsima/Fast-DDS, issue 6502, open). From then on
nothing is received, and nobody else notices: the process itself lives.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

_TIMERS = "dds.ev."
"""How the names of these threads begin, one for each participant."""


class StandstillWatch:
    """Asks Linux whether the timers' threads run.

    Parameters
    ----------
    looks : int
        Looks in a row without a sign of one of them, after which it counts as locked out.
    """

    def __init__(self, looks: int) -> None:
        self._looks = looks
        self._seen: dict[Path, tuple[str, int]] = {}

    def look(self) -> bool:
        """Look once; gives whether Fast DDS stands still."""
        seen = {}
        for task in Path("/proc/self/task").iterdir():
            with contextlib.suppress(OSError):  # it has ended
                text = (task / "status").read_text()
                if text.startswith(f"Name:\t{_TIMERS}"):
                    status = dict(line.split(":\t", 1) for line in text.splitlines())
                    slept = status["voluntary_ctxt_switches"]  # how often
                    before, idle = self._seen.get(task, ("", 0))
                    still = slept == before and status["State"].startswith("S")
                    seen[task] = slept, idle + 1 if still else 0
        self._seen = seen
        return any(idle >= self._looks for _, idle in seen.values())
