"""Start the four nodes, keep them running, end them together.

`Suite` is a context manager for programs and tests::

    with Suite(bank="bank.npz") as suite:   # returns when all four are ready
        ...                                 # topics are live
                                            # all four have ended here

`up` is the same as a command that runs until SIGINT, SIGTERM or SIGHUP. Each node is an ordinary process. One
that dies or hangs is restarted: at once at first, and up to 10 s later if it keeps dying. Output of a
process is prefixed with its name. If the supervisor is killed, all end.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import wait
from pathlib import Path
from types import TracebackType
from typing import Any

from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.core.printable import printable
from depth_pose.ros import stay_local
from depth_pose.ros.process import NODES
from depth_pose.ros.process.child import Child
from depth_pose.ros.process.interfaces import check_interfaces
from depth_pose.ros.process.pulse import PULSE
from depth_pose.ros.process.runner import EXIT_CONFIG, on_stop
from depth_pose.ros.process.security import check_security
from depth_pose.ros.process.shared_memory import remove_leftovers

__all__ = ["NODES", "SENSORS_PATH", "NodeDiedError", "Suite", "sensor_names", "up"]

SENSORS_PATH = Path(__file__).parents[1] / "sensors"
"""Parameter files of known sensor drivers, NAME.yaml."""

_ENVIRONMENT = {PULSE: "1", "PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of the nodes: signs of life; unbuffered lines; one thread each, as they share the cores."""

_CONSUMERS = {"denoise": 1, "matcher": 1, "refine": 1, "recovery": 0, "fusion": 0}
"""Number of nodes of the suite that subscribe to each node's outputs; it is ready once they have."""

_LOOK_EVERY_S, _STOP_PATIENCE_S = 0.1, 5.0
"""Seconds between checks without events, and until a process that does not end is killed."""

_LONGEST_LOOK_S = 0.5
"""Maximum seconds that one check can add to a silence or a wait: the machine itself may have been paused."""

_FIRST_DELAY_S, _MAX_DELAY_S = 0.1, 10.0
"""Seconds before a process that died young twice is restarted; doubles up to the maximum."""

HEALTHY_S = 3.0
"""A process that was ready for at least this long (s) before its last sign of life restarts at once.
A bug or a bad frame ends a process while it loads or with its first frames.
"""


class NodeDiedError(DepthPoseError):
    """A node ended before it was ready; the message holds its last lines of output."""


def sensor_names() -> list[str]:
    """Names of the sensor presets of `up` and `Suite`."""
    return sorted(p.stem for p in SENSORS_PATH.glob("*.yaml"))


class Suite:
    """The four nodes as processes.

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
        Which of `NODES` to run, or ``("fusion",)``.
    remap : sequence of str
        ROS remapping rules, e.g. ``("__ns:=/left",)`` for a second suite in the same domain.
    sink : callable
        Receives every line of output, with ``[name] `` in front; prints it by default.

    Attributes
    ----------
    failure : DepthPoseError or None
        The reason if the suite cannot continue.
    """

    def __init__(
        self,
        params_file: str | Path | None = None,
        sensor: str | None = None,
        bank: str | Path | None = None,
        *,
        parameters: Mapping[str, Any] | None = None,
        nodes: Sequence[str] = NODES,
        remap: Sequence[str] = (),
        sink: Callable[[str], None] | None = None,
    ) -> None:
        self.failure: DepthPoseError | None = None
        given = _ros_arguments(params_file, sensor, bank, parameters or {}, remap)
        self._arguments = {name: ["--ros-args", *_links(name, nodes), *given] for name in nodes}
        self._sink = sink or _print
        self._children: dict[str, Child] = {}
        self._restarts: Counter[str] = Counter()
        self._due_s: dict[str, float] = {}
        self._delay_s: dict[str, float] = {}
        self._looked_s = time.monotonic()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="supervisor", daemon=True)

    @property
    def restarts(self) -> dict[str, int]:
        """Number of restarts of each node."""
        return {name: self._restarts[name] for name in self._arguments}

    def pid(self, name: str) -> int | None:
        """Process id of a node; None while it is down."""
        child = self._children.get(name)
        return child.pid if child is not None and child.code is None else None

    def is_ready(self, name: str) -> bool:
        """Whether a node has reported ready since it was last started."""
        child = self._children.get(name)
        return child is not None and child.ready_s < math.inf and child.code is None

    def lived_s(self, name: str) -> float:
        """Seconds from when a node was ready to its last sign of life; minus infinity before it is ready."""
        child = self._children.get(name)
        return child.lived_s if child is not None else -math.inf

    def start(self) -> None:
        """Start all nodes; returns at once, see `wait_ready`."""
        if self._thread.ident is not None:
            raise DepthPoseError("this suite has been started; make a new one")
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
        deadline_s = time.monotonic() + timeout_s
        while missing := [name for name in self._arguments if not self.is_ready(name)]:
            if self.failure is not None:
                raise self.failure
            if time.monotonic() > deadline_s:
                child = self._children.get(missing[0])
                said = _last_words(child) if child is not None else ""
                raise NodeDiedError(f"the {missing[0]} was not ready in {timeout_s:.0f} s:\n{said}")
            time.sleep(0.02)

    def stop(self) -> dict[str, int]:
        """End all nodes; return their exit codes, 0 where they ended cleanly."""
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join()
        return {name: child.code or 0 for name, child in self._children.items()}

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

    # In a separate thread

    def _run(self) -> None:
        while not self._stopping.is_set() and self.failure is None:
            for name in self._arguments:
                self._look_after(name)
            self._look()
        for child in self._children.values():
            child.end()
        waited_s = 0.0
        while any(child.code is None for child in self._children.values()):
            waited_s += self._look()
            if waited_s > _STOP_PATIENCE_S:
                for child in self._children.values():
                    child.kill()
        remove_leftovers()

    def _look_after(self, name: str) -> None:
        """Start a node that does not run."""
        last = self._children.get(name)
        if last is not None:
            if last.code is None or time.monotonic() < self._due_s[name]:
                return
            self._restarts[name] += 1
        command = [sys.executable, "-m", f"depth_pose.ros.nodes.{name}_node", *self._arguments[name]]
        self._children[name] = Child(name, command, os.environ | _ENVIRONMENT)

    def _look(self) -> float:
        """Handle events and silence for one period; return its duration, limited."""
        alive = [child for child in self._children.values() if child.code is None]
        news: Sequence[Any] = wait(alive, _LOOK_EVERY_S)
        last_s, self._looked_s = self._looked_s, time.monotonic()
        waited_s = min(self._looked_s - last_s, _LONGEST_LOOK_S)
        for child in alive:
            if child in news:
                child.read(self._sink)
            child.kill_if_hung(waited_s, self._sink)
            if child.code is not None:
                remove_leftovers()
                if not self._stopping.is_set() and self.failure is None:
                    self._take_end(child)
        return waited_s

    def _take_end(self, child: Child) -> None:
        """Schedule a restart: at once, or with growing delay if processes die young."""
        name, was_ready = child.name, child.ready_s < math.inf
        may_go_on = was_ready or self._restarts[name] or child.code == 0  # 0: for instance it has starved
        if child.code == EXIT_CONFIG or not may_go_on:
            kind = ConfigError if child.code == EXIT_CONFIG else NodeDiedError
            what = f"the {name} ended with code {child.code} before it was ready"
            self.failure = kind(f"{what}:\n{_last_words(child)}")
            return
        wait_s = self._delay_s.get(name, 0.0) if child.lived_s < HEALTHY_S else 0.0
        after = f"in {wait_s:.1f} s" if wait_s else "at once"
        self._sink(f"[{name}] ended with code {child.code}; starting it again {after}")
        self._due_s[name] = time.monotonic() + wait_s
        self._delay_s[name] = min(max(_FIRST_DELAY_S, 2.0 * wait_s), _MAX_DELAY_S)


def up(
    params_file: str | Path | None = None,
    sensor: str | None = None,
    bank: str | Path | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    remap: Sequence[str] = (),
    local: bool = False,
    nodes: Sequence[str] = NODES,
    skeletons: str = "skeletons",
) -> int:
    """Run nodes until SIGINT, SIGTERM or SIGHUP; signals are handled in the main thread.

    Parameters are those of `Suite`; ``local`` keeps all of it to this machine (`depth_pose.ros.stay_local`),
    and ``skeletons`` is the topic of the result, below the namespace.

    Returns
    -------
    int
        0 where all nodes ended cleanly, else 1.

    Raises
    ------
    ConfigError, NodeDiedError
        If a node cannot start, no network interface is up, or SROS2 is asked for and does not start.
    """
    stop = threading.Event()
    if local:
        stay_local()
    check_interfaces()
    check_security()
    suite = Suite(params_file, sensor, bank, parameters=parameters, remap=remap, nodes=nodes)
    namespace = dict(rule.partition(":=")[::2] for rule in remap).get("__ns", "depth_pose").strip("/")
    ready = printable(f"all nodes are ready; skeletons come on /{namespace}/{skeletons}, Ctrl-C ends")
    with on_stop(stop.set):
        suite.start()
        try:
            while not stop.wait(0.1) and suite.failure is None:
                if ready and all(map(suite.is_ready, nodes)):
                    _print(ready)
                    ready = ""
        finally:
            codes = suite.stop()
    if suite.failure is not None:
        raise suite.failure
    return 0 if not any(codes.values()) else 1


def _links(name: str, nodes: Sequence[str]) -> list[str]:
    """Return the parameters for the connections that a node waits for before it is ready."""
    whole = set(nodes) == set(NODES)
    return ["-p", f"consumers:={_CONSUMERS[name] * whole}", "-p", f"producers:={str(whole).lower()}"]


def _ros_arguments(
    params_file: str | Path | None,
    sensor: str | None,
    bank: str | Path | None,
    parameters: Mapping[str, Any],
    remap: Sequence[str] = (),
) -> list[str]:
    arguments: list[str] = []
    for rule in remap:
        if not all(rule.partition(":=")[::2]):
            raise ConfigError(f"{rule!r} renames nothing; write FROM:=TO, e.g. __ns:=/left")
        arguments += ["-r", rule]
    if sensor is not None:
        if sensor not in sensor_names():
            raise ConfigError(f"no sensor {sensor!r} is known; there are {', '.join(sensor_names())}")
        arguments += ["--params-file", str(SENSORS_PATH / f"{sensor}.yaml")]
    if params_file is not None:
        if not Path(params_file).is_file():
            raise ConfigError(f"no parameter file {params_file}")
        arguments += ["--params-file", str(params_file)]
    values = dict(parameters) | ({"bank": str(Path(bank).absolute())} if bank is not None else {})
    for name, value in values.items():
        arguments += ["-p", f"{name}:={json.dumps(value)}"]  # which is YAML
    return arguments


def _last_words(child: Child) -> str:
    return "\n".join(child.last_lines) or "it said nothing"


def _print(line: str) -> None:
    with contextlib.suppress(OSError):  # its reader has ended, or the disk is full
        print(line, flush=True)
