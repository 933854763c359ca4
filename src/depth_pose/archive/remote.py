"""Recordings on remote storage, by URL: each is fetched, processed and removed in turn.

`fsspec` supports many kinds of storage: ``http``, ``s3``, ``gs``, ``ftp``, ``sftp`` and more, each with its
own package. A recording is copied as a whole to a temporary folder of the worker: its index is at its end,
and its content decides whether it was processed before.
"""

from __future__ import annotations

import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from glob import has_magic
from pathlib import Path, PurePosixPath
from typing import Any

from depth_pose.core.errors import ConfigError, InputError

_URL = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)

SPARE_BYTES = 256 << 20
"""Space left free in the folder for temporary files, which other programs use too."""

SILENT_S = 60.0
"""Maximum silence of a server (s); the whole copy may take any time."""

_LEAST_RATE = 1000
"""Minimum rate of a copy (bytes/s) after `SILENT_S`; a slower one fails."""

LISTED_S, MOST_LISTED_BYTES = 300.0, 64 << 20
"""Maximum time to list a folder (s), and maximum size of the list: half a million names."""


def is_remote(text: str) -> bool:
    """Whether an input is a URL."""
    return _URL.match(text) is not None


def find_remote(url: str, ending: str) -> list[tuple[str, str, int]]:
    """Find the recordings of a URL: a file, a folder or a pattern.

    Parameters
    ----------
    url : str
    ending : str
        Extension of recordings in folders and patterns.

    Returns
    -------
    list of (str, str, int)
        URL, name within the archive, and size in bytes, 0 where the storage does not report it.

    Raises
    ------
    InputError
        Where the storage does not answer, or there is no such file.
    ConfigError
        Where the package for this kind of storage is not installed.
    """
    storage, path = _open(url, LISTED_S)
    try:
        if has_magic(path):
            fixed = path[: re.search(r"[*?\[]", path).start()].rpartition("/")[0]  # type: ignore[union-attr]
            paths = storage.glob(path)
        elif path.endswith(ending) or (storage.isfile(path) and not storage.isdir(path)):
            fixed, paths = path.rpartition("/")[0], [path] if storage.exists(path) else []
        else:
            fixed, paths = path.rstrip("/"), storage.find(path)
        return [
            (storage.unstrip_protocol(found), name, storage.size(found) or 0)
            for found in sorted(paths)
            if found.endswith(ending) and (name := name_below(found, fixed)) is not None
        ]
    except Exception as error:  # each kind of storage raises its own
        raise InputError(f"{url} cannot be read: {_reason(error)}") from error


def name_below(path: str, fixed: str) -> str | None:
    """Return a recording's name below a folder; None for a path outside it."""
    if not path.startswith(f"{fixed}/"):
        return None
    name = PurePosixPath(path[len(fixed) + 1 :]).with_suffix("")
    return None if ".." in name.parts or name.is_absolute() else str(name)


def _open(url: str, total_s: float | None = None) -> tuple[Any, str]:
    """Return the storage of a URL and the path in it; no request may take longer than ``total_s``."""
    missing = "reading {} needs more than is installed ({}): pip install 'depth_pose[remote]'"
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise ConfigError(missing.format(url, error)) from error
    options: dict[str, Any] = {}
    try:
        if url.lower().startswith("http"):
            options["client_kwargs"] = _patience(total_s)
        storage, path = url_to_fs(url, **options)
    except ImportError as error:
        raise ConfigError(missing.format(url, error)) from error
    except Exception as error:  # an unknown kind, missing credentials
        raise InputError(f"{url} cannot be read: {_reason(error)}") from error
    return storage, path


def _patience(total_s: float | None) -> dict[str, Any]:
    """Return a wrapper that limits the time of a request, and the size of an answer."""
    from aiohttp import ClientResponse, ClientTimeout

    class Bounded(ClientResponse):
        async def text(self, encoding: str | None = None, errors: str = "replace") -> str:
            found = bytearray()
            while piece := await self.content.read(1 << 20):
                found += piece
                if len(found) > MOST_LISTED_BYTES:
                    raise InputError(f"its list has more than {MOST_LISTED_BYTES >> 20} MiB")
            return found.decode(encoding or "utf-8", errors)

    limits = ClientTimeout(total=total_s, sock_connect=SILENT_S, sock_read=SILENT_S)
    return {"timeout": limits, "response_class": Bounded}


def _reason(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _watching(folder: Path) -> Any:
    """Return the fsspec callback that aborts a copy when the disk is full or the server too slow."""
    from fsspec.callbacks import Callback

    start = time.monotonic()

    class Watch(Callback):  # type: ignore[misc, unused-ignore]
        def relative_update(self, inc: int = 1) -> None:
            super().relative_update(inc)
            if shutil.disk_usage(folder).free < SPARE_BYTES:
                raise InputError(
                    f"{folder.parent} has less than {SPARE_BYTES >> 20} MiB left after {self.value} bytes; "
                    "TMPDIR may name another folder for temporary files"
                )
            took = time.monotonic() - start
            if took > SILENT_S and self.value < _LEAST_RATE * took:
                raise InputError(f"the server sent only {self.value} bytes in {took:.0f} s")

    return Watch()


@contextmanager
def fetched(recording: str) -> Iterator[str]:
    """Yield a recording's local path: its own, or a temporary copy.

    Raises
    ------
    InputError
        Where it cannot be fetched.
    """
    if not is_remote(recording):
        yield recording
        return
    storage, path = _open(recording)
    with tempfile.TemporaryDirectory(prefix="depth_pose-") as folder:
        local = Path(folder) / (PurePosixPath(path).name or "recording")
        try:
            storage.get_file(path, str(local), callback=_watching(Path(folder)))
        except Exception as error:  # each kind of storage raises its own
            raise InputError(f"{recording} cannot be fetched: {_reason(error)}") from error
        yield str(local)
