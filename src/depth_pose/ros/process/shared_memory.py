"""Shared memory of Fast DDS: unreadable for other accounts, and removed after killed processes.

Fast DDS does not connect programs of two accounts by it, and then uses no other way: topics are listed, and
nothing comes.

Fast DDS keeps 16 MiB of /dev/shm for each process (`depth_pose.ros.PROFILE_PATH`), and a lock file
that the process holds as long as it lives.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from pathlib import Path

from depth_pose.ros import PROFILE_VARIABLE, UDP_PROFILE_PATH

_FOLDER, _LOCK, _YOUNG_S = Path("/dev/shm"), "_el", 0.5
"""Its folder, the suffix of a lock's name, and seconds for which a new lock file may not be locked yet."""

_LOCKS = Path("/proc/locks")
"""All locks of the system, by the inodes of their files."""


def keep_private() -> None:
    """Make this process's shared memory unreadable for other accounts; call it after joining the graph.

    Fast DDS lets everybody read it, regardless of the umask: boost sets 0644 once a file is made.
    """
    for link in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):  # closed meanwhile
            lock = link.readlink()
            if lock.parent == _FOLDER and lock.match(f"fastrtps_*{_LOCK}"):
                lock.with_name(lock.name.removesuffix(_LOCK)).chmod(0o600)


def remove_leftovers() -> None:
    """Remove segments whose owner has ended, as ``fastdds shm clean`` does.

    Ports stay: others write to them, and learn from a new owner when one takes over; they would notice a
    missing port only after a second.
    """
    for lock in _FOLDER.glob(f"fastrtps_*{_LOCK}"):
        if "port" in lock.name:
            continue
        with contextlib.suppress(OSError), lock.open("r+b") as handle:  # else another user's, or gone
            if abs(time.time() - lock.stat().st_mtime) > _YOUNG_S:  # the clock may have been set back
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails where the owner lives
                lock.with_name(lock.name.removesuffix(_LOCK)).unlink(missing_ok=True)
                lock.unlink(missing_ok=True)


def with_account_advice(text: str) -> str:
    """Return an error's text with `other_account_advice` behind it."""
    return "; ".join(filter(None, (text, other_account_advice())))


def other_account_advice() -> str:
    """Return what to do where programs of other accounts use the shared memory; empty otherwise."""
    held, owners = set(), set()
    with contextlib.suppress(OSError):  # the files of another account's locks cannot be opened
        held = {line.rpartition(" 0 EOF")[0].rpartition(":")[2] for line in _LOCKS.read_text().splitlines()}
    for lock in _FOLDER.glob(f"fastrtps_*{_LOCK}"):
        with contextlib.suppress(OSError):  # gone
            found = lock.stat()
            if str(found.st_ino) in held:  # its owner lives
                owners.add(found.st_uid)
    others = ", ".join(str(owner) for owner in sorted(owners - {os.geteuid()}))
    if not others:
        return ""
    return (
        f"programs of another account (user id {others}) run here, and shared memory does not connect two "
        f"accounts: run both as one, or start one with {PROFILE_VARIABLE}={UDP_PROFILE_PATH}"
    )
