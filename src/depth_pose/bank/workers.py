"""Run the parts of a build: in this process, in processes of this machine, or on a Dask cluster.

The parts do not depend on each other and come back in their order, so what is made of them does
not depend on who did the work.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any, TypeVar

from depth_pose.core.errors import ConfigError, InputError

T = TypeVar("T")
Task = tuple[Any, ...]

_CONNECT_S = "10s"
"""How long a Dask scheduler may take to answer."""


def run_parts(
    function: Callable[..., T],
    tasks: Sequence[Task],
    workers: int | None = None,
    scheduler: str | None = None,
) -> Iterator[T]:
    """Call a function with each task's arguments; results come in the order of the tasks.

    Parameters
    ----------
    function : callable
        Of a module, so that other processes can import it.
    tasks : sequence of tuple
        Arguments of each call.
    workers : int, optional
        Processes; all cores by default, 0 works in this process.
    scheduler : str, optional
        Address of a Dask scheduler, ``tcp://host:8786``.

    Raises
    ------
    ConfigError
        Where Dask is asked for and not installed.
    InputError
        Where the scheduler cannot be reached, or a worker dies.
    """
    if scheduler is not None:
        return _run_on_cluster(function, tasks, scheduler)
    count = min(_cores() if workers is None else workers, len(tasks))
    if count == 0:
        return (function(*task) for task in tasks)
    return _run_in_processes(function, tasks, count)


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _run_in_processes(function: Callable[..., T], tasks: Sequence[Task], count: int) -> Iterator[T]:
    with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
        futures = deque(pool.submit(function, *task) for task in tasks)
        try:
            while futures:
                yield futures.popleft().result()
        except BrokenProcessPool as error:
            raise InputError(
                "a worker process of the bank's build died, perhaps for want of memory; use fewer --workers"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _run_on_cluster(function: Callable[..., T], tasks: Sequence[Task], scheduler: str) -> Iterator[T]:
    try:
        from distributed import Client
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise ConfigError(
            "--scheduler needs Dask, which is not installed: pip install 'depth_pose[dask]'"
        ) from error
    try:
        client = Client(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {scheduler}: {error}") from error
    with client:
        if not client.scheduler_info()["workers"]:
            raise InputError(f"the Dask scheduler at {scheduler} has no workers; start some: dask worker")
        # pure=False: the arguments are not hashed; the same call twice is two tasks
        futures = deque(client.submit(function, *task, pure=False) for task in tasks)
        try:
            while futures:
                yield futures.popleft().result()
        except KilledWorker as error:
            raise InputError(f"the Dask workers at {scheduler} died at their work: {error}") from error
