"""Shared memory that processes left behind when they were killed.

Fast DDS keeps 32 MiB of /dev/shm for each process, and beside it a lock file that the process holds as
long as it lives. A killed process cannot remove them (``fastdds shm clean`` does what is done here).
"""

from __future__ import annotations

import contextlib
import fcntl
import time
from pathlib import Path

FOLDER = Path("/dev/shm")
_LOCK = "_el"

_YOUNG_S = 0.5
"""Seconds; a younger file may belong to a process that has not locked it yet. Set by hand."""


def remove_leftovers() -> int:
    """Remove the segments whose owners are dead; gives how many there were."""
    segments = [lock for lock in FOLDER.glob(f"fastrtps_*{_LOCK}") if "port" not in lock.name]
    return sum(map(_remove_if_dead, segments))


def _remove_if_dead(lock: Path) -> bool:
    with contextlib.suppress(OSError), lock.open("r+b") as handle:  # else another user's, or gone
        if time.time() - lock.stat().st_mtime > _YOUNG_S:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails where the owner lives
            lock.with_name(lock.name.removesuffix(_LOCK)).unlink(missing_ok=True)
            lock.unlink(missing_ok=True)
            return True
    return False
