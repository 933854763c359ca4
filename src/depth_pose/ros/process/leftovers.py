"""Shared memory that processes left behind when they were killed.

Fast DDS keeps messages in files of /dev/shm, 32 MiB for each process, beside a lock file that the owner
holds as long as it lives. What is killed cannot remove its own, and the memory is gone until the machine
starts again, or somebody cleans up (`fastdds shm clean` does the same).
"""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

FOLDER = Path("/dev/shm")
_LOCK = "_el"
_YOUNG_S = 0.5
"""A file as young as this may belong to a process that has not locked it yet."""


def remove_leftovers() -> int:
    """Remove the segments whose owners are dead; gives how many there were."""
    segments = [lock for lock in FOLDER.glob(f"fastrtps_*{_LOCK}") if "port" not in lock.name]
    return sum(map(_remove_if_dead, segments))


def _remove_if_dead(lock: Path) -> bool:
    try:
        if time.time() - lock.stat().st_mtime < _YOUNG_S:
            return False
        handle = os.open(lock, os.O_RDWR | os.O_CLOEXEC)
    except OSError:  # another user's, or gone
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.with_name(lock.name.removesuffix(_LOCK)).unlink(missing_ok=True)
        lock.unlink(missing_ok=True)
    except OSError:  # its owner lives
        return False
    finally:
        os.close(handle)
    return True
