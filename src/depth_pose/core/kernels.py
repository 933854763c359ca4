"""Compiled kernels: numba's `njit`, cached on disk wherever a folder can be written.

numba keeps compiled code beside the source, else in the user's cache, and refuses ``cache=True`` where
neither can be written. Then, and where another account could write to the cache, a private folder is used,
since cached code is executed; without one, each process compiles its kernels.
Where files of the cache are damaged, as a power cut leaves them, their kernel is compiled again; what a full
disk does not take is compiled again by the next process.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache

from depth_pose.core.errors import raise_if_interrupted
from depth_pose.core.private_folder import is_private, is_writable, private_folder


def njit(*functions: Callable[..., Any], **options: Any) -> Any:
    """Compile a function as `numba.njit` does, without ``cache`` if there is no writable folder."""
    cached = options.pop("cache", False) and _HAS_CACHE
    compile_it: Any = numba.njit

    def compile_one(function: Callable[..., Any]) -> Any:
        # nothing calls kernels from C, and the wrapper for it takes a twentieth of the time
        kernel = compile_it(function, no_cfunc_wrapper=True, nogil=True, **options)
        if cached:
            kernel._cache = _MendingCache(function)  # what enable_caching() does, with another cache
        return kernel

    return compile_one(*functions) if functions else compile_one


def is_compiled(kernel: Any) -> bool:
    """Return whether a cached kernel need not be compiled: its code is on disk, or there is no cache."""
    cache = kernel._cache
    return not isinstance(cache, _MendingCache) or cache.has_code()


class _MendingCache(FunctionCache):
    """numba's cache of a function: emptied if it cannot be read, left as it is if it cannot be written."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code, or None: not cached, or damaged."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # unpickling and LLVM raise any type; after None numba compiles and saves
            raise_if_interrupted(error)
            self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code, unless the disk is full."""
        with suppress(OSError):  # numba removes what it began to write
            super().save_overload(sig, data)

    def has_code(self) -> bool:
        """Return whether there is code of today's source, for any types."""
        return bool(self._cache_file._load_index())


def _find_cache() -> bool:
    """Return whether numba has a folder for its cache; name a private one where it has no other."""
    beside = Path(__file__).parent / "__pycache__"
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        usual = [Path(given)]
    else:
        home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
        usual = [beside, Path(home) / "numba"]
    # what stands beside the source is as safe as the source; other folders may be open to other accounts
    if any(is_writable(f) and (f == beside or is_private(f)) for f in usual):
        return True
    own = private_folder("kernels")
    if own is None:
        return False
    os.environ["NUMBA_CACHE_DIR"] = str(own)  # for child processes
    config: Any = numba.config
    config.CACHE_DIR = str(own)
    return True


_HAS_CACHE = _find_cache()
