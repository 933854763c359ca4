"""Compiled kernels: numba's `njit`, with a cache that nothing around it can stop.

numba keeps compiled code beside the source, else in the user's cache. Where neither can be written, it
refuses to start; where a file of its is damaged, it raises, or ends the process. Here a private folder
takes their place, every file ends with a hash of its content, and one that does not fit is made anew.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

from depth_pose.core.private_folder import is_writable, private_folder

_DIGEST_BYTES = 32
"""Length of a SHA-256 hash."""


def njit(*functions: Callable[..., Any], **options: Any) -> Any:
    """Compile a function as `numba.njit` does, without ``cache`` where there is no folder for it."""
    if not _HAS_CACHE:
        options.pop("cache", None)
    compile_it: Any = numba.njit
    return compile_it(*functions, **options)


def _find_cache() -> bool:
    """See to it that numba has a folder to keep what it compiles in; False where there is none."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        usual = [Path(given)]
    else:
        home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
        usual = [Path(__file__).parent / "__pycache__", Path(home) / "numba"]
    if any(map(is_writable, usual)):
        return True
    own = private_folder("kernels")
    if own is None:
        return False
    os.environ["NUMBA_CACHE_DIR"] = str(own)  # for the processes that this one starts
    config: Any = numba.config
    config.CACHE_DIR = str(own)
    return True


class _CheckedFiles(caching.IndexDataCacheFile):  # type: ignore[misc]
    """Files of the cache that are known to be whole; anything else counts as missing."""

    def save(self, key: Any, data: Any) -> None:
        """Save what was compiled; a full disk is no reason to stop."""
        try:
            super().save(key, data)
        except OSError:
            return

    def _dump(self, obj: Any) -> bytes:
        content = super()._dump(obj)
        return bytes(content) + hashlib.sha256(content).digest()  # what is behind a pickle is not read

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except Exception:  # a damaged pickle raises a dozen kinds
            return {}

    def _load_data(self, name: str) -> Any:
        whole = Path(self._data_path(name)).read_bytes()
        content, digest = whole[:-_DIGEST_BYTES], whole[-_DIGEST_BYTES:]
        if hashlib.sha256(content).digest() != digest:
            raise OSError("damaged, or not written by this package")  # which numba takes for a missing file
        return super()._load_data(name)


_HAS_CACHE = _find_cache()
caching.IndexDataCacheFile = _CheckedFiles  # type: ignore[misc]
