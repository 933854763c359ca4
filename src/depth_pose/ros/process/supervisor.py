"""Start the four nodes, keep them running, end them together.

`Suite` is a context manager for programs and tests::

    with Suite(bank="bank.npz") as suite:   # returns when all four are ready
        ...                                 # topics are live
                                            # all four have ended here

`up` is the same as a command that runs until SIGINT or SIGTERM. Each node is a process, forked from one
that has everything loaded, the host (`depth_pose.ros.process.host`). A process that dies or hangs is started
again: at once at first, and up to 10 s later when it goes on dying. One more process is forked as a spare,
which takes the place of such a node, and a second host, which takes the place of the first. A process' output
appears with its name in front. If the supervisor is killed, all end.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import selectors
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.ros import stay_local
from depth_pose.ros.process import HOST, NODES, SECOND_HOST, SPARE
from depth_pose.ros.process.child import LONGEST_LOOK_S, Child
from depth_pose.ros.process.leftovers import remove_leftovers
from depth_pose.ros.process.runner import EXIT_CONFIG, on_stop

__all__ = ["NODES", "SENSORS_PATH", "NodeDiedError", "Suite", "sensor_names", "up"]

SENSORS_PATH = Path(__file__).parents[1] / "sensors"
"""Parameter files of known sensor drivers, NAME.yaml."""

_HOST_MODULE = "depth_pose.ros.process.host"

_CONSUMERS = {"denoise": 3, "matcher": 1, "refine": 1, "recovery": 1}
"""Nodes of the suite that subscribe to what each publishes; it is ready once they have."""

_LOOK_EVERY_S, _STOP_PATIENCE_S = 0.1, 5.0
"""Seconds between looks where there is no news, and until a process that does not end is killed."""

_PR_SET_CHILD_SUBREAPER = 36
"""Of Linux' prctl: processes whose parent has ended become this one's, which then learns how they end."""


class NodeDiedError(DepthPoseError):
    """A node ended before it was ready; the message holds its last words."""


def sensor_names() -> list[str]:
    """Sensors that `up` and `Suite` know by name."""
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
        Which of `NODES` to run.
    remap : sequence of str
        ROS' rules for names, e.g. ``("__ns:=/left",)`` for a second suite in the same domain.
    sink : callable
        Gets every line of output, with ``[name] `` in front; prints it by default.

    Attributes
    ----------
    failure : DepthPoseError or None
        Why the suite cannot go on, if so.
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
        self._bank = str(Path(bank).absolute()) if bank is not None else ""
        given = _ros_arguments(params_file, sensor, bank, parameters or {}, remap)
        self._arguments = {name: ["--ros-args", *_links(name, nodes), *given] for name in nodes}
        self._sink = sink or _print
        self._children: dict[str, Child] = {}
        self._selector = selectors.DefaultSelector()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="supervisor", daemon=True)

    @property
    def restarts(self) -> dict[str, int]:
        """How often each node was started again."""
        return {n: self._children[n].restarts if n in self._children else 0 for n in self._arguments}

    def pid(self, name: str) -> int | None:
        """Process id of a node, the "spare", the "host" or the "second host"; None while it is down."""
        child = self._children.get(name)
        return child.pid if child is not None and child.code is None else None

    def is_ready(self, name: str) -> bool:
        """Whether a node has said so since it was last started; the spare could then take over at once."""
        child = self._children.get(name)
        return child is not None and child.is_ready and child.code is None

    def start(self) -> None:
        """Start all nodes; returns at once, see `wait_ready`."""
        if self._thread.ident is not None:
            raise DepthPoseError("this suite has been started; make a new one")
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
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
        for name in self._arguments:
            while not self.is_ready(name):
                if self.failure is not None:
                    raise self.failure
                if time.monotonic() > deadline_s:
                    said = self._children[name].last_words if name in self._children else ""
                    raise NodeDiedError(f"the {name} was not ready in {timeout_s:.0f} s:\n{said}")
                time.sleep(0.02)

    def stop(self) -> dict[str, int]:
        """End all nodes; gives their exit codes, 0 where they ended cleanly."""
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join()
        there = {n: c for n, c in self._children.items() if n in self._arguments and c.pid is not None}
        return {n: c.code or 0 for n, c in there.items()}

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

    # In a thread of its own

    def _run(self) -> None:
        while not self._stopping.is_set() and self.failure is None:
            for name in (HOST, *self._arguments):
                self._look_after(name)
            if all(child.is_ready for child in self._children.values()):
                for name in (SECOND_HOST, SPARE):
                    if name not in self._children:
                        self._start(name)
            self._look()
        for child in self._children.values():
            child.end()
        waited_s, looked_s = 0.0, time.monotonic()
        while any(child.code is None for child in self._children.values()):
            self._look()
            last_s, looked_s = looked_s, time.monotonic()
            waited_s += min(looked_s - last_s, LONGEST_LOOK_S)
            if waited_s > _STOP_PATIENCE_S:
                for child in self._children.values():
                    child.kill()
        remove_leftovers()

    def _look_after(self, name: str) -> None:
        """Start a process; where it has ended, its deputy takes its place if there is one."""
        last = self._children.get(name)
        if last is not None and (last.code is None or time.monotonic() < last.retry_s):
            return
        deputy = self._children.get(SECOND_HOST if name == HOST else SPARE)
        if last is not None and deputy is not None and deputy.is_ready:
            self._children[name] = self._children.pop(deputy.name)
            deputy.become(name, self._arguments.get(name, []))
        else:
            self._start(name)
        if last is not None:
            self._children[name].follow(last)

    def _start(self, name: str) -> None:
        if name == HOST:
            # a process with threads of its own cannot fork
            alone = {"PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
            command = [sys.executable, "-W", "ignore:This process", "-m", _HOST_MODULE, self._bank]
            child = Child.spawned(name, command, os.environ | alone)
        else:
            child = Child.forked(name, self._arguments.get(name, []), self._children[HOST])
        self._children[name] = child
        self._selector.register(child.socket, selectors.EVENT_READ, child)

    def _look(self) -> None:
        """See to what comes, and to what does not."""
        for key, _ in self._selector.select(_LOOK_EVERY_S):
            key.data.read(self._sink)
        for child in list(self._children.values()):
            child.kill_if_hung(self._sink)
            if child.code is not None and child.socket.fileno() >= 0:
                self._selector.unregister(child.socket)
                child.socket.close()
                remove_leftovers()
                if not self._stopping.is_set() and self.failure is None:
                    self._take_end(child)

    def _take_end(self, child: Child) -> None:
        if child.name in (SECOND_HOST, SPARE):
            del self._children[child.name]
        elif child.code == EXIT_CONFIG or (child.restarts == 0 and not child.is_ready and child.pid):
            kind = ConfigError if child.code == EXIT_CONFIG else NodeDiedError
            what = f"the {child.name} ended with code {child.code} before it was ready"
            self.failure = kind(f"{what}:\n{child.last_words}")
        else:
            child.plan_retry(self._sink)


def up(
    params_file: str | Path | None = None,
    sensor: str | None = None,
    bank: str | Path | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    remap: Sequence[str] = (),
    local: bool = False,
) -> int:
    """Run the four nodes until SIGINT or SIGTERM; signals are heard in the main thread.

    Parameters are those of `Suite`; ``local`` keeps all of it to this machine (`depth_pose.ros.stay_local`).

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
    if local:
        stay_local()
    suite = Suite(params_file, sensor, bank, parameters=parameters, remap=remap)
    with on_stop(stop.set):
        suite.start()
        try:
            _watch(suite, stop, _namespace(remap))
        finally:
            codes = suite.stop()
    return 0 if not any(codes.values()) else 1


def _namespace(remap: Sequence[str]) -> str:
    rules = dict(rule.partition(":=")[::2] for rule in remap)
    return rules.get("__ns", "depth_pose").strip("/")


def _watch(suite: Suite, stop: threading.Event, namespace: str) -> None:
    told = False
    while not stop.wait(0.1):
        if suite.failure is not None:
            raise suite.failure
        if not told and all(map(suite.is_ready, NODES)):
            told = True
            _print(f"all nodes are ready; skeletons come on /{namespace}/skeletons, Ctrl-C ends")


def _links(name: str, nodes: Sequence[str]) -> list[str]:
    """Say whom a node waits for before it is ready."""
    whole = set(nodes) == set(NODES)
    consumers = _CONSUMERS[name] if whole else 0
    return ["-p", f"consumers:={consumers}", "-p", f"producers:={str(whole).lower()}"]


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


def _print(line: str) -> None:
    with contextlib.suppress(OSError):  # nobody reads it, or the disk that it goes to is full
        print(line, flush=True)
