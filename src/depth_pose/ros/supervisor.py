"""Start the four nodes, keep them running, end them together.

`Suite` is a context manager for programs and tests::

    with Suite(bank="bank.npz") as suite:   # returns when all four are ready
        ...                                 # topics are live
                                            # all four have ended here

`up` is the same as a command that runs until SIGINT or SIGTERM. Each node is a process of its
own (``python -m depth_pose.ros.NAME_node``) whose output appears with its name in front. One
that dies is started again, after 0.1 s at first and up to 10 s when it goes on dying; a spare process
that has everything loaded takes its place (`depth_pose.ros.spare`). Should the supervisor itself be
killed, the kernel ends the nodes.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from depth_pose.errors import ConfigError, DepthPoseError
from depth_pose.ros.runner import EXIT_CONFIG, PARENT_VARIABLE, on_stop
from depth_pose.ros.spare import LOADED

NODES: tuple[str, ...] = ("denoise", "matcher", "refine", "recovery")
"""The nodes, in the order that a frame passes them."""

SENSORS_PATH = Path(__file__).with_name("sensors")
"""Parameter files of known sensor drivers, NAME.yaml."""

_CONSUMERS = {"denoise": 3, "matcher": 1, "refine": 1, "recovery": 1}
_READY = "is ready"
_FIRST_DELAY_S, _MAX_DELAY_S, _HEALTHY_S = 0.1, 10.0, 10.0
_STOP_PATIENCE_S = 3.0


class NodeDiedError(DepthPoseError):
    """A node ended before it was ready; the message holds its last words."""


def sensor_names() -> list[str]:
    """Sensors that `up` and `Suite` know by name."""
    return sorted(p.stem for p in SENSORS_PATH.glob("*.yaml"))


@dataclass
class _Child:
    name: str
    process: subprocess.Popen[str] | None = None
    started_s: float = 0.0
    ready: threading.Event = field(default_factory=threading.Event)
    restarts: int = 0
    delay_s: float = _FIRST_DELAY_S
    retry_s: float | None = None
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
    spare : bool
        Whether to keep a spare process, which costs the memory of one more node. All four only.
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
        spare: bool = True,
        sink: Callable[[str], None] | None = None,
    ) -> None:
        self._arguments = _ros_arguments(params_file, sensor, bank, parameters or {})
        self._sink = sink or _print
        self._children = {name: _Child(name) for name in nodes}
        self._whole = set(nodes) == set(NODES)
        self._keeps_spare = spare and self._whole
        self._spare = _Child("spare")
        self._owners: dict[int, _Child] = {}
        self._bank = str(Path(bank).absolute()) if bank is not None else ""
        self._stopping = threading.Event()
        self._failed: DepthPoseError | None = None
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()

    @property
    def restarts(self) -> dict[str, int]:
        """How often each node was started again."""
        return {name: child.restarts for name, child in self._children.items()}

    def pid(self, name: str) -> int | None:
        """Process id of a node, None while it is down."""
        process = self._children[name].process
        return process.pid if process is not None and process.poll() is None else None

    def start(self) -> None:
        """Start all nodes; returns at once, see `wait_ready`."""
        if self._thread is not None:
            raise DepthPoseError("this suite has been started; make a new one")
        # the kernel ties a child to the *thread* that started it: this one lives as long as they do
        self._thread = threading.Thread(target=self._supervise, name="supervisor", daemon=True)
        self._thread.start()

    def wait_ready(self, timeout_s: float = 120.0) -> None:
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
                    words = "\n".join(child.last_lines) or "it said nothing"
                    raise NodeDiedError(f"the {child.name} node was not ready in {timeout_s:.0f} s:\n{words}")

    def is_ready(self, name: str) -> bool:
        """Whether a node has said so since it was last started."""
        return self._children[name].ready.is_set()

    @property
    def has_spare(self) -> bool:
        """Whether a spare process is loaded and waits."""
        return self._spare.ready.is_set()

    @property
    def failure(self) -> DepthPoseError | None:
        """Why the suite cannot go on, if so."""
        return self._failed

    def stop(self) -> dict[str, int]:
        """End all nodes; gives their exit codes, 0 where they ended cleanly."""
        self._stopping.set()
        with self._lock:
            running = {n: c.process for n, c in self._children.items() if c.process is not None}
            spare = self._spare.process
        for process in (*running.values(), *([spare] if spare is not None else [])):
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        deadline = time.monotonic() + _STOP_PATIENCE_S
        codes = {name: _wait(process, deadline) for name, process in running.items()}
        if spare is not None:
            _wait(spare, deadline)
        if self._thread is not None:
            self._thread.join()
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
        for child in self._children.values():
            self._spawn(child)
        while not self._stopping.wait(0.1):
            for child in self._children.values():
                self._look_after(child)
            self._look_after_spare()

    def _spawn(self, child: _Child) -> None:
        with self._lock:
            if self._stopping.is_set():
                return
            child.ready.clear()
            child.retry_s = None
            child.started_s = time.monotonic()
            consumers = _CONSUMERS[child.name] if self._whole else 0
            producers = _yaml(self._whole)
            arguments = [
                *("--ros-args", "-p", f"consumers:={consumers}", "-p", f"producers:={producers}"),
                *self._arguments,
            ]
            if self._take_spare(child, arguments):
                return
            self._start(child, f"{child.name}_node", arguments)

    def _start(self, child: _Child, module: str, arguments: Sequence[str], waits: bool = False) -> None:
        """Start a module as a process, and read what it prints."""
        child.process = subprocess.Popen(
            [sys.executable, "-m", f"depth_pose.ros.{module}", *arguments],
            stdin=subprocess.PIPE if waits else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            bufsize=1,
            start_new_session=True,  # Ctrl-C reaches the supervisor only
            env=_environment(),
        )
        self._owners[child.process.pid] = child
        reader = threading.Thread(target=self._read, args=(child.process,), daemon=True)
        reader.start()

    def _take_spare(self, child: _Child, arguments: list[str]) -> bool:
        """Have the spare process become a node, if it is there and loaded."""
        process = self._spare.process
        if process is None or process.stdin is None or not self.has_spare or process.poll() is not None:
            return False
        self._owners[process.pid], child.process = child, process
        self._spare = _Child("spare")
        with contextlib.suppress(OSError):  # where it died just now, the next look finds it
            process.stdin.write(json.dumps([child.name, arguments]) + "\n")
            process.stdin.close()
        return True

    def _look_after_spare(self) -> None:
        """Start a spare once all nodes are ready, so that it takes no time from their start."""
        spare = self._spare
        if not self._keeps_spare or self._failed is not None:
            return
        if spare.process is not None:
            if spare.process.poll() is not None:
                self._keeps_spare = self.has_spare  # one that cannot load is not tried again
                self._spare = _Child("spare")
            return
        if all(c.ready.is_set() for c in self._children.values()):
            with self._lock:
                if not self._stopping.is_set():
                    self._start(spare, "spare", [self._bank] if self._bank else [], waits=True)

    def _read(self, process: subprocess.Popen[str]) -> None:
        for line in process.stdout or ():
            line = line.rstrip("\n")
            child = self._owners[process.pid]
            child.last_lines.append(line)
            if (LOADED if child is self._spare else _READY) in line:
                child.ready.set()
                if child is self._spare:
                    continue
            self._sink(f"[{child.name}] {line}")

    def _look_after(self, child: _Child) -> None:
        now = time.monotonic()
        if child.process is None or self._failed is not None:
            return
        if child.retry_s is not None:
            if now >= child.retry_s:
                child.restarts += 1
                self._spawn(child)
            return
        code = child.process.poll()
        if code is None or self._stopping.is_set():
            return
        was_ready = child.ready.is_set()
        child.ready.clear()
        if code == EXIT_CONFIG or (not was_ready and child.restarts == 0):
            time.sleep(0.1)  # let its last lines come
            kind = ConfigError if code == EXIT_CONFIG else NodeDiedError
            words = "\n".join(child.last_lines)
            self._failed = kind(f"the {child.name} node ended with code {code} before it was ready:\n{words}")
            return
        if now - child.started_s > _HEALTHY_S:
            child.delay_s = _FIRST_DELAY_S
        self._sink(f"[{child.name}] ended with code {code}; starting it again in {child.delay_s:.1f} s")
        child.retry_s = now + child.delay_s
        child.delay_s = min(2.0 * child.delay_s, _MAX_DELAY_S)


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


def _wait(process: subprocess.Popen[str], deadline: float) -> int:
    try:
        return process.wait(max(0.1, deadline - time.monotonic()))
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def _environment() -> dict[str, str]:
    environment = dict(os.environ)
    environment[PARENT_VARIABLE] = str(os.getpid())
    environment["PYTHONUNBUFFERED"] = "1"
    environment.setdefault("OMP_NUM_THREADS", "1")  # four processes share the cores
    return environment


def _print(line: str) -> None:
    print(line, flush=True)
