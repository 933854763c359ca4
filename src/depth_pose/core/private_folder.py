"""A private folder for caches, where the usual ones cannot be written."""

from __future__ import annotations

import getpass
import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from depth_pose.core.system import account


def is_writable(folder: Path) -> bool:
    """Whether files can be created in a folder; it is created if missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def is_private(folder: Path) -> bool:
    """Check that no other account can put files into a folder: its owner and mode, and those of all above it.

    The group may write if it is the user's own, of the same number; anybody may above it if only owners can
    rename (sticky folders such as ``/tmp``).
    """
    try:
        full = folder.resolve()
        return all(_is_safe(path.stat(), is_above=path != full) for path in (full, *full.parents))
    except OSError:
        return False


def _is_safe(found: os.stat_result, *, is_above: bool) -> bool:
    user = account()
    if user is None:  # the system's access lists decide
        return True
    if found.st_uid not in (user, 0) or (found.st_uid != user and not is_above):
        return False
    if is_above and found.st_mode & stat.S_ISVTX:
        return True
    others = stat.S_IWOTH if found.st_gid == user else stat.S_IWOTH | stat.S_IWGRP
    return not found.st_mode & others


def private_folder(name: str) -> Path | None:
    """Return a private folder below the system's folder for temporary files.

    It is the same for all processes of the user, so that they share its content. If another user has taken
    that name, a new folder is made.

    Parameters
    ----------
    name : str
        Name of the folder within it.

    Returns
    -------
    Path or None
        None where no folder can be made.
    """
    try:
        user = account()
        own = Path(tempfile.gettempdir()) / f"depth_pose-{getpass.getuser() if user is None else user}"
        with suppress(FileExistsError):
            own.mkdir(mode=0o700)
        found = own.lstat()
        is_own = user is None or (found.st_uid == user and not found.st_mode & 0o077)
        if not (stat.S_ISDIR(found.st_mode) and is_own):
            own = Path(tempfile.mkdtemp(prefix="depth_pose-"))
    except OSError:
        return None
    return own / name if is_writable(own / name) else None
