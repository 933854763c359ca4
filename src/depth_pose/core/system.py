"""Calls that not every system has: file locks, flags of opened files, numbers of accounts.

Linux and macOS have all of them, Windows none: there an open file cannot be removed or replaced by others,
which serves for the lock, and folders of an account are private by its access list.
"""

from __future__ import annotations

import os
from contextlib import suppress

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


HAS_LOCKS = fcntl is not None
"""Whether files and folders can be locked."""


def open_flags(*names: str) -> int:
    """Return the flags of `os.open` of these names, without those that the system lacks; always for bytes."""
    flags = getattr(os, "O_BINARY", 0)
    for name in names:
        flags |= getattr(os, name, 0)
    return int(flags)


def lock(number: int) -> None:
    """Lock an open file for this process alone, after any other; nothing where the system has no locks."""
    if fcntl is not None:
        with suppress(OSError):  # some file systems have none
            fcntl.flock(number, fcntl.LOCK_EX)


def try_lock(number: int) -> None:
    """Lock an open file for this process alone, or raise; nothing where the system has no locks.

    Raises
    ------
    BlockingIOError
        If another process holds it.
    OSError
        If the file system has no locks.
    """
    if fcntl is not None:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)


def account() -> int | None:
    """Return the number of the account; None where accounts have none."""
    return os.geteuid() if hasattr(os, "geteuid") else None
