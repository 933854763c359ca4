"""The shared memory that killed processes leave behind."""

from __future__ import annotations

import contextlib
import fcntl
import time
from pathlib import Path

_SHARED_MEMORY, _YOUNG_S = Path("/dev/shm"), 0.5
"""Where Fast DDS keeps its segments; a lock file younger than this, in seconds, may yet be locked."""


def remove_leftovers() -> None:
    """Remove segments whose owner is gone.

    Fast DDS keeps 32 MiB of /dev/shm for each process, and beside it a lock file that the process holds
    as long as it lives (``fastdds shm clean`` does what is done here). Ports stay: others write to them, and
    whoever takes one over tells them so; a port that is gone they would miss only after a second.
    """
    for lock in _SHARED_MEMORY.glob("fastrtps_*_el"):
        if "port" in lock.name:
            continue
        with contextlib.suppress(OSError), lock.open("r+b") as handle:  # else another user's, or gone
            if time.time() - lock.stat().st_mtime > _YOUNG_S:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails where the owner lives
                lock.with_name(lock.name.removesuffix("_el")).unlink(missing_ok=True)
                lock.unlink(missing_ok=True)
