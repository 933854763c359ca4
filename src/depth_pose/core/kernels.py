"""Compiled kernels: numba's `njit`, with a cache that nothing around it can stop.

numba keeps compiled code beside the source, else in the user's cache. Where neither can be written, it
refuses to start; where a file of its is damaged, it raises, or ends the process. Here a private folder
takes their place, every file ends with a hash of its content, and one that does not fit is made anew.
What is loaded is loaded quickly: all that only compiling needs waits until something is compiled.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core import caching, codegen
from numba.core.runtime.nrt import rtsys

from depth_pose.core.private_folder import is_writable, private_folder

_DIGEST_BYTES = 32
"""Length of a SHA-256 hash."""


def njit(*functions: Callable[..., Any], **options: Any) -> Any:
    """Compile a function as `numba.njit` does, without ``cache`` where there is no folder for it."""
    if not _HAS_CACHE:
        options.pop("cache", None)
    compile_it: Any = numba.njit
    made = compile_it(*functions, **options)
    return _load_quickly(made) if functions else lambda function: _load_quickly(made(function))


def _load_quickly(kernel: Any) -> Any:
    """Have a kernel's cache load what was compiled without all that numba can compile, .3 s of work."""
    if type(getattr(kernel, "_cache", None)) is caching.FunctionCache:
        kernel._cache.__class__ = _QuickCache
    return kernel


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


class _QuickCache(caching.FunctionCache):  # type: ignore[misc]
    """Cache that tells numba's context of what it can compile only where it has to compile."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load what was compiled for a signature; None where nothing was."""
        rtsys.initialize(target_context)  # what compiled code calls
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class _Library(codegen.JITCodeLibrary):  # type: ignore[misc]
    """Compiled code; of what comes from the cache, the part that other kernels link is read when one does.

    Its symbols' names are saved with it: to ask LLVM for them takes longer than all else.
    """

    _bitcode = b""

    def serialize_using_object_code(self) -> Any:
        """Give what is saved."""
        name, kind, (code, bitcode) = super().serialize_using_object_code()
        mod = self._get_module_for_linking()
        parts = (*mod.functions, *mod.global_variables)
        return name, kind, (code, bitcode, [part.name for part in parts if not part.is_declaration])

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, data = state
        if kind != "object" or len(data) != 3:
            return super()._unserialize(codegen, state)
        library = codegen.create_library(name)
        code, library._bitcode, symbols = data
        library.enable_object_caching()
        library._set_compiled_object(code)
        library._finalize_final_module()
        codegen._engine._defined_symbols.update(symbols)
        return library

    def _get_module_for_linking(self) -> Any:
        if self._bitcode:
            self._shared_module, self._bitcode = llvm.parse_bitcode(self._bitcode), b""
        return super()._get_module_for_linking()


_HAS_CACHE = _find_cache()
codegen.JITCPUCodegen._library_class = _Library
caching.IndexDataCacheFile = _CheckedFiles  # type: ignore[misc]
