"""Run the parts of a task: in this process, in processes of this machine, or on a Dask cluster.

The parts do not depend on each other, and results do not depend on where they were computed.
`run_parts` is for a task that needs all of them, `run_each` for one that continues without those that
fail.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection, get_context, parent_process
from pickle import PicklingError
from typing import Any, Generic, TypeVar

from depth_pose.core.errors import InputError
from depth_pose.core.extras import require

T = TypeVar("T")
Task = tuple[Any, ...]
Tell = Callable[[float], None]
"""Function that a part calls with its fraction done, 0 to 1."""
Listen = Callable[[int, float], None]
"""Function called with a part's number and its fraction done."""

CONNECT_S = "10s"
"""Time limit for a Dask scheduler to answer."""

_TRIES = 2
"""Number of attempts for a part whose process dies; on Dask, its own ``allowed-failures`` counts."""

_NEARLY = 0.999
"""Maximum fraction reported for a part before its outcome."""

_END_S = 5.0
"""Time for a process to clean up when asked to end; then it is killed. Not swept."""


@dataclass(frozen=True)
class Outcome(Generic[T]):
    """Outcome of one part: its number, and its value or the error that ended it."""

    index: int
    value: T | None = None
    error: Exception | None = None


Outcomes = Generator[Outcome[T], None, None]


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
        Where the scheduler cannot be reached, or workers keep dying.
    """
    early: dict[int, T] = {}
    due = 0
    with closing(run_each(_Untold(function), tasks, workers, scheduler)) as outcomes:
        for outcome in outcomes:
            if outcome.error is not None:
                raise outcome.error
            early[outcome.index] = outcome.value  # type: ignore[assignment]
            while due in early:
                yield early.pop(due)
                due += 1


@dataclass(frozen=True)
class _Untold(Generic[T]):
    """A function that does not report progress."""

    function: Callable[..., T]

    def __call__(self, *arguments: Any) -> T:
        return self.function(*arguments[:-1])


def run_each(
    function: Callable[..., T],
    tasks: Sequence[Task],
    workers: int | None = None,
    scheduler: str | None = None,
    listen: Listen | None = None,
) -> Outcomes[T]:
    """Call a function with each task's arguments; yield outcomes as they are done.

    A process that dies is replaced, and its task is started once more; if that dies as well, the outcome is
    an `InputError`. Closing the generator ends the processes: on SIGTERM they raise `SystemExit`, so that
    unfinished work is cleaned up. They end by themselves if this process is killed.

    Parameters
    ----------
    function : callable
        Defined in a module, so that other processes can import it. Its last argument, after the task's, is
        a function (`Tell`) to report progress.
    tasks, workers, scheduler
        As of `run_parts`.
    listen : callable, optional
        Receives the progress of the tasks; not from a cluster.

    Raises
    ------
    ConfigError
        Where Dask is asked for and not installed.
    InputError
        Where the scheduler cannot be reached.
    """
    listen = listen or _nobody_listens
    if scheduler is not None:
        return _run_on_cluster(function, tasks, scheduler)
    count = min(cores() if workers is None else workers, len(tasks))
    if count == 0:
        return _run_here(function, tasks, listen)
    return _run_in_processes(function, tasks, count, listen)


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _nobody_listens(*_: Any) -> None:
    """Ignore progress."""


def _run_here(function: Callable[..., T], tasks: Sequence[Task], listen: Listen) -> Outcomes[T]:
    for index, task in enumerate(tasks):
        yield Outcome(index, *_attempt(function, task, partial(listen, index)))


def _attempt(function: Callable[..., T], task: Task, tell: Tell) -> tuple[T | None, Exception | None]:
    """Return the value and None, or None and the error."""
    try:
        return function(*task, tell), None
    except Exception as error:
        return None, error


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Block Ctrl-C within the context, where the system can."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Worker:
    """A process that calls the function with one task after another."""

    def __init__(self, function: Callable[..., Any]) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(function, theirs), daemon=True)
        # Ctrl-C goes to all processes of a terminal; the first one decides. Blocked signals are inherited
        with without_interrupts():
            self.process.start()
        theirs.close()
        self.index = -1

    def begin(self, index: int, task: Task) -> None:
        """Send a task."""
        self.index = index
        with suppress(OSError):  # if it has died, `receive` reports it
            self.pipe.send(task)

    def hear(self) -> tuple[float, Any] | None:
        """Receive the share done, and at 1 the value and the error; None if the process died."""
        try:
            return self.pipe.recv()
        except (EOFError, OSError):
            return None

    def end(self) -> None:
        """End the process."""
        self.process.terminate()
        self.process.join(_END_S)
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _run_in_processes(
    function: Callable[..., T], tasks: Sequence[Task], count: int, listen: Listen
) -> Outcomes[T]:
    waiting = deque(range(len(tasks)))
    deaths: Counter[int] = Counter()
    busy: dict[Any, Worker] = {}

    def begin(worker: Worker) -> None:
        index = waiting.popleft()
        worker.begin(index, tasks[index])
        busy[worker.pipe] = worker

    idle = [Worker(function) for _ in range(count)]  # all start at the same time
    try:
        while idle or busy:
            while idle and waiting:
                begin(idle.pop())
            for pipe in connection.wait(list(busy)) if busy else ():
                worker = busy[pipe]
                index = worker.index
                heard = worker.hear()
                if heard is None:
                    busy.pop(pipe).end()
                    deaths[index] += 1
                    if deaths[index] < _TRIES:
                        waiting.append(index)
                    else:
                        yield Outcome(index, error=_death(worker.process.exitcode))
                    if waiting:
                        idle.append(Worker(function))
                elif heard[0] < 1.0:
                    listen(index, heard[0])
                else:
                    idle.append(busy.pop(pipe))
                    yield Outcome(index, *heard[1])
            if not waiting:
                for worker in idle:
                    worker.end()
                idle.clear()
    finally:
        left = [*idle, *busy.values()]
        for worker in left:
            worker.process.terminate()
        for worker in left:
            worker.end()


def _death(code: int | None) -> InputError:
    how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
    return InputError(
        f"the process that worked on it died {_TRIES} times, the last time by {how}; "
        "if that was for want of memory, use fewer --workers"
    )


def _serve(function: Callable[..., Any], pipe: connection.Connection) -> None:
    """Work until the pipe is closed; runs in a separate process."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        outcome = _attempt(function, task, lambda share: pipe.send((min(share, _NEARLY), None)))
        try:
            pipe.send((1.0, outcome))
        except (TypeError, AttributeError, PicklingError) as error:
            pipe.send((1.0, (None, InputError(f"its result cannot be sent: {error}: {outcome}"))))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _one_line_of(name: str) -> Iterator[None]:
    """Silence a library's logger, which reports a lost connection as a traceback beside our error."""
    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _run_on_cluster(function: Callable[..., T], tasks: Sequence[Task], scheduler: str) -> Outcomes[T]:
    require("distributed", "working on a cluster")
    from distributed import Client, as_completed
    from distributed.scheduler import KilledWorker

    try:
        client = Client(scheduler, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {scheduler}: {error}") from error
    with _one_line_of("distributed.client"), client:
        if not client.scheduler_info()["workers"]:
            raise InputError(f"the Dask scheduler at {scheduler} has no workers; start some: dask worker")
        # pure=False: the arguments are not hashed; the same call twice is two tasks
        futures = [client.submit(function, *task, _nobody_listens, pure=False) for task in tasks]
        numbers = {future.key: index for index, future in enumerate(futures)}
        for future in as_completed(futures):
            index = numbers[future.key]
            if future.cancelled():
                raise InputError(f"the Dask scheduler at {scheduler} is gone")
            failed = future.exception()
            if isinstance(failed, KilledWorker):
                failed = InputError(f"the Dask workers at {scheduler} died repeatedly: {failed}")
            yield Outcome(index, error=failed) if failed else Outcome(index, future.result())
            future.release()
