"""Start the four nodes, keep them running, end them together.

`Suite` is a context manager for programs and tests::

    with Suite(bank="bank.npz") as suite:   # returns when all four are ready
        ...                                 # topics are live
                                            # all four have ended here

`up` is the same as a command that runs until SIGINT or SIGTERM. Each node is a process of its
own, forked from one that has everything loaded (`depth_pose.ros.process.forkserver`); its output appears with
its name in front. A spare that waits forked beside them takes the place of a node that dies: at once
at first, and up to 10 s later when it goes on dying. Should the supervisor itself be killed, the nodes
end, too; should the fork server be, they go on, and another is started.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.ros.process.forked import ForkedProcess, ForkServer, ServerDiedError
from depth_pose.ros.process.forkserver import LOADED, WAITS
from depth_pose.ros.process.leftovers import remove_leftovers
from depth_pose.ros.process.runner import EXIT_CONFIG, PARENT_VARIABLE, on_stop

NODES: tuple[str, ...] = ("denoise", "matcher", "refine", "recovery")
"""The nodes, in the order that a frame passes them."""

SENSORS_PATH = Path(__file__).parents[1] / "sensors"
"""Parameter files of known sensor drivers, NAME.yaml."""

_CONSUMERS = {"denoise": 3, "matcher": 1, "refine": 1, "recovery": 1}
_READY = "is ready"
_FIRST_DELAY_S, _MAX_DELAY_S, _HEALTHY_S = 0.1, 10.0, 10.0
_LOOK_EVERY_S, _STOP_PATIENCE_S = 0.1, 5.0


class NodeDiedError(DepthPoseError):
    """A node ended before it was ready; the message holds its last words."""


def sensor_names() -> list[str]:
    """Sensors that `up` and `Suite` know by name."""
    return sorted(p.stem for p in SENSORS_PATH.glob("*.yaml"))


@dataclass
class _Child:
    """A process by what it is for, and the words by which it says that it is ready."""

    name: str
    word: str = _READY
    process: ForkedProcess | None = None
    started_s: float = 0.0
    ready: threading.Event = field(default_factory=threading.Event)
    restarts: int = 0
    delay_s: float = 0.0
    retry_s: float | None = 0.0
    killed: bool = False
    last_lines: deque[str] = field(default_factory=lambda: deque(maxlen=20))


class Suite:
    """The four nodes as child processes.

    Parameters
    ----------
    params_file : path, optional
        ROS parameter file (key ``/**:``), given to all nodes.
    sensor : str, optional
        One of `sensor_names`: the topics of a known driver; `params_file` overrides it.
    bank : path, optional
        Exemplar bank; the set-up's default otherwise.
    parameters : mapping, optional
        Single parameters, e.g. ``{"refine.method": "cpd", "use_sim_time": True}``; they override
        the files.
    nodes : sequence of str
        Which of `NODES` to run.
    sink : callable
        Gets every line of output, with ``[name] `` in front; prints it by default.

    Attributes
    ----------
    restarts : dict of str to int
        How often each node was started again.
    """

    def __init__(
        self,
        params_file: str | Path | None = None,
        sensor: str | None = None,
        bank: str | Path | None = None,
        *,
        parameters: Mapping[str, Any] | None = None,
        nodes: Sequence[str] = NODES,
        sink: Callable[[str], None] | None = None,
    ) -> None:
        self._arguments = _ros_arguments(params_file, sensor, bank, parameters or {})
        self._sink = sink or _print
        self._children = {name: _Child(name) for name in nodes}
        self._whole = set(nodes) == set(NODES)
        self._spare = _Child("spare", WAITS)
        self._loader = _Child("fork server", LOADED)
        self._server: ForkServer | None = None
        self._owners: dict[int, _Child] = {}
        self._bank = str(Path(bank).absolute()) if bank is not None else ""
        self._stopping = threading.Event()
        self._failed: DepthPoseError | None = None
        self._thread: threading.Thread | None = None

    @property
    def restarts(self) -> dict[str, int]:
        """How often each node was started again."""
        return {name: child.restarts for name, child in self._children.items()}

    def pid(self, name: str) -> int | None:
        """Process id of a node, None while it is down."""
        process = self._children[name].process
        return process.pid if process is not None and process.is_running else None

    def start(self) -> None:
        """Start all nodes; returns at once, see `wait_ready`."""
        if self._thread is not None:
            raise DepthPoseError("this suite has been started; make a new one")
        self._thread = threading.Thread(target=self._supervise, name="supervisor", daemon=True)
        self._thread.start()

    def wait_ready(self, timeout_s: float = 300.0) -> None:
        """Wait until every node has warmed up and is connected.

        The first start on a machine compiles the kernels, which takes a while.

        Raises
        ------
        ConfigError
            If a node refuses its parameters or its bank.
        NodeDiedError
            If a node ends before it is ready, or none of this happens in time.
        """
        deadline = time.monotonic() + timeout_s
        for child in self._children.values():
            while not child.ready.wait(0.05):
                if self._failed is not None:
                    raise self._failed
                if time.monotonic() > deadline:
                    words = "\n".join(child.last_lines or self._loader.last_lines) or "it said nothing"
                    raise NodeDiedError(f"the {child.name} was not ready in {timeout_s:.0f} s:\n{words}")

    def is_ready(self, name: str) -> bool:
        """Whether a node has said so since it was last started."""
        return self._children[name].ready.is_set()

    @property
    def spare_pid(self) -> int | None:
        """Process id of the spare, None while there is none that could take over at once."""
        process = self._spare.process
        return process.pid if process is not None and self._spare.ready.is_set() else None

    @property
    def server_pid(self) -> int | None:
        """Process id of the fork server, None before the start."""
        return self._server.process.pid if self._server is not None else None

    @property
    def failure(self) -> DepthPoseError | None:
        """Why the suite cannot go on, if so."""
        return self._failed

    def stop(self) -> dict[str, int]:
        """End all nodes; gives their exit codes, 0 where they ended cleanly."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
        running = {n: c.process for n, c in self._children.items() if c.process is not None}
        spare = [self._spare.process] if self._spare.process is not None else []
        for process in (*running.values(), *spare):
            process.send_signal(signal.SIGTERM)
        deadline = time.monotonic() + _STOP_PATIENCE_S
        codes = {name: process.wait(deadline) for name, process in running.items()}
        for process in spare:
            process.wait(deadline)
        if self._server is not None:
            self._server.close()
        remove_leftovers()
        return codes

    def __enter__(self) -> Suite:
        self.start()
        try:
            self.wait_ready()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    # The supervising thread

    def _supervise(self) -> None:
        try:
            while not self._stopping.is_set() and self._failed is None:
                with contextlib.suppress(ServerDiedError):  # another is started
                    self._look_after_all()
        except DepthPoseError as e:
            self._failed = e
        except Exception:
            self._failed = DepthPoseError(f"the supervisor failed:\n{traceback.format_exc()}")

    def _look_after_all(self) -> None:
        if self._has_server():
            for child in self._children.values():
                self._look_after(child)
            self._look_after_spare()

    def _has_server(self) -> bool:
        """Wait for news of the fork server, and start it where it is not; True if it is loaded."""
        loader = self._loader
        look_s = _LOOK_EVERY_S if loader.ready.is_set() else 0.2 * _LOOK_EVERY_S
        if self._server is not None and self._server.listen(look_s):
            return loader.ready.is_set()
        if self._server is not None:
            self._server.close()
            code = self._server.process.returncode
            if not loader.ready.is_set():
                raise NodeDiedError(_last_words(loader, code))
            self._sink(f"[{loader.name}] ended with code {code}; starting it again")
            loader.ready.clear()
        self._server = ForkServer(self._bank, _environment())
        self._follow(self._server.process, loader)
        return False

    def _spawn(self, child: _Child) -> None:
        """Have the spare, or a new process, become a node."""
        assert self._server is not None
        spare = self._spare.process
        ready = spare is not None and self._spare.ready.is_set() and spare.poll() is None
        if ready:
            self._spare = _Child("spare", WAITS)
        process = spare if ready and spare is not None else self._server.fork()
        child.restarts += child.process is not None
        self._owners[process.pid], child.process = child, process
        if not ready:
            self._follow(process, child)
        child.ready.clear()
        child.retry_s = None
        child.started_s = time.monotonic()
        consumers = _CONSUMERS[child.name] if self._whole else 0
        producers = _yaml(self._whole)
        arguments = [
            *("--ros-args", "-p", f"consumers:={consumers}", "-p", f"producers:={producers}"),
            *self._arguments,
        ]
        with contextlib.suppress(OSError):  # where it died just now, the next look finds it
            process.stdin.write(json.dumps([child.name, arguments]) + "\n")
            process.stdin.close()

    def _look_after_spare(self) -> None:
        """Fork a spare once all nodes are ready, so that it takes no time from their start."""
        spare = self._spare
        if spare.process is not None:
            if spare.process.poll() is not None:
                self._spare = _Child("spare", WAITS)
        elif self._server is not None and all(c.ready.is_set() for c in self._children.values()):
            if any(c.killed for c in self._children.values()):
                remove_leftovers()
            spare.process = self._server.fork()
            self._follow(spare.process, spare)

    def _follow(self, process: subprocess.Popen[str] | ForkedProcess, owner: _Child) -> None:
        """Read what a process prints, in a thread of its own."""
        self._owners[process.pid] = owner
        threading.Thread(target=self._read, args=(process,), daemon=True).start()

    def _read(self, process: subprocess.Popen[str] | ForkedProcess) -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                line = line.rstrip("\n")
                child = self._owners[process.pid]
                child.last_lines.append(line)
                if child.word in line:
                    child.ready.set()
                if line not in (LOADED, WAITS):
                    self._sink(f"[{child.name}] {line}")
        self._owners.pop(process.pid, None)

    def _look_after(self, child: _Child) -> None:
        now = time.monotonic()
        code = child.process.poll() if child.process is not None and child.retry_s is None else None
        if code is not None:
            was_ready = child.ready.is_set()
            child.ready.clear()
            if code == EXIT_CONFIG or (not was_ready and child.restarts == 0):
                time.sleep(0.1)  # let its last lines come
                kind = ConfigError if code == EXIT_CONFIG else NodeDiedError
                raise kind(_last_words(child, code))
            if now - child.started_s > _HEALTHY_S:
                child.delay_s = 0.0
            after = f"in {child.delay_s:.1f} s" if child.delay_s else "at once"
            self._sink(f"[{child.name}] ended with code {code}; starting it again {after}")
            child.retry_s, child.killed = now + child.delay_s, code < 0
            child.delay_s = min(max(_FIRST_DELAY_S, 2.0 * child.delay_s), _MAX_DELAY_S)
        if child.retry_s is not None and now >= child.retry_s:
            self._spawn(child)


def up(
    params_file: str | Path | None = None,
    sensor: str | None = None,
    bank: str | Path | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
) -> int:
    """Run the four nodes until SIGINT or SIGTERM; signals are heard in the main thread.

    Parameters are those of `Suite`.

    Returns
    -------
    int
        0 where all nodes ended cleanly, else 1.

    Raises
    ------
    ConfigError, NodeDiedError
        If a node cannot start.
    """
    stop = threading.Event()
    suite = Suite(params_file, sensor, bank, parameters=parameters)
    with on_stop(stop.set):
        suite.start()
        try:
            _watch(suite, stop)
        finally:
            codes = suite.stop()
    return 0 if not any(codes.values()) else 1


def _watch(suite: Suite, stop: threading.Event) -> None:
    told = False
    while not stop.wait(0.1):
        if suite.failure is not None:
            raise suite.failure
        if not told and all(suite.is_ready(name) for name in NODES):
            told = True
            _print("all nodes are ready; skeletons come on /depth_pose/skeleton, Ctrl-C ends")


def _ros_arguments(
    params_file: str | Path | None,
    sensor: str | None,
    bank: str | Path | None,
    parameters: Mapping[str, Any],
) -> list[str]:
    arguments: list[str] = []
    if sensor is not None:
        path = SENSORS_PATH / f"{sensor}.yaml"
        if sensor not in sensor_names():
            raise ConfigError(f"no sensor {sensor!r} is known; there are {', '.join(sensor_names())}")
        arguments += ["--params-file", str(path)]
    if params_file is not None:
        if not Path(params_file).is_file():
            raise ConfigError(f"no parameter file {params_file}")
        arguments += ["--params-file", str(params_file)]
    values = dict(parameters)
    if bank is not None:
        values["bank"] = str(Path(bank).absolute())
    for name, value in values.items():
        arguments += ["-p", f"{name}:={_yaml(value)}"]
    return arguments


def _yaml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, int | float) else f"'{value}'"


def _last_words(child: _Child, code: int) -> str:
    words = "\n".join(child.last_lines) or "it said nothing"
    return f"the {child.name} ended with code {code} before it was ready:\n{words}"


def _environment() -> dict[str, str]:
    environment = dict(os.environ)
    environment[PARENT_VARIABLE] = str(os.getpid())
    environment["PYTHONUNBUFFERED"] = "1"
    environment.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")  # a process with threads cannot fork
    return environment


def _print(line: str) -> None:
    print(line, flush=True)
