"""Threads for the people of a frame: kernels and nets release the interpreter's lock."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ContextDecorator
from typing import TypeVar

from threadpoolctl import LibController, ThreadpoolController

from depth_pose.core.errors import ConfigError

Given = TypeVar("Given")
Made = TypeVar("Made")

MOST_THREADS = 2
"""Maximum number of threads. More were not measured."""


def check_threads(count: int) -> int:
    """Return a number of threads.

    Raises
    ------
    ConfigError
        If it is neither 1 nor 2.
    """
    if isinstance(count, bool) or count not in range(1, MOST_THREADS + 1):
        raise ConfigError(f"threads is {count!r}; it is 1 or {MOST_THREADS}")
    return count


class Threads:
    """Calls a function for several arguments, in threads if there are several of both.

    Parameters
    ----------
    count : int
        Number of threads; with 1 the caller's is used.
    """

    def __init__(self, count: int = 1) -> None:
        self._pool = ThreadPoolExecutor(count, "depth_pose") if count > 1 else None

    def map(self, function: Callable[[Given], Made], arguments: Iterable[Given]) -> list[Made]:
        """Return the function's values in the order of the arguments; raise the first one's error."""
        given = list(arguments)
        if self._pool is None or len(given) < 2:
            return [function(one) for one in given]
        return list(self._pool.map(function, given))


ONE_THREAD = Threads()


class _OneThreadEach(ContextDecorator):
    """Limit linear algebra to one thread as long as any thread is within the context."""

    def __init__(self) -> None:
        self._libraries: list[LibController] | None = None
        self._lock, self._within = threading.Lock(), 0

    def __enter__(self) -> None:
        with self._lock:
            if self._libraries is None:  # those that are loaded by now
                self._libraries = ThreadpoolController().lib_controllers
            if self._within == 0:
                counts = [(library, library.get_num_threads()) for library in self._libraries]
                self._limited = [(library, count) for library, count in counts if count != 1]
                for library, _ in self._limited:
                    library.set_num_threads(1)
            self._within += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._within -= 1
            if self._within == 0:
                for library, count in self._limited:
                    library.set_num_threads(count)


one_thread_each = _OneThreadEach()
"""Small systems gain nothing from more threads, and one keeps the order of sums."""
