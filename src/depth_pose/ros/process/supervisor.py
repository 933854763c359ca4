"""Start the four nodes, keep them running, end them together.

`Suite` is a context manager for programs and tests::

    with Suite(bank="bank.npz") as suite:   # returns when all four are ready
        ...                                 # topics are live
                                            # all four have ended here

`up` is the same as a command that runs until SIGINT or SIGTERM. Each node is a process, forked from one
that has everything loaded (`depth_pose.ros.process.forkserver`); its output appears with its name in
front. One more is forked as a spare. It takes the place of a node that dies: at once at first, and up to
10 s later when the node goes on dying. If the supervisor is killed, the nodes end, too. If the fork
server is, they go on, and another is started.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.ros.process.child import Child, ForkServer
from depth_pose.ros.process.leftovers import remove_leftovers
from depth_pose.ros.process.names import NODES
from depth_pose.ros.process.runner import EXIT_CONFIG, on_stop

__all__ = ["NODES", "SENSORS_PATH", "NodeDiedError", "Suite", "sensor_names", "up"]

SENSORS_PATH = Path(__file__).parents[1] / "sensors"
"""Parameter files of known sensor drivers, NAME.yaml."""

_CONSUMERS = {"denoise": 3, "matcher": 1, "refine": 1, "recovery": 1}
"""Nodes of the suite that subscribe to what each publishes; it is ready once they have."""

_FIRST_DELAY_S, _MAX_DELAY_S = 0.1, 10.0
"""Seconds before a node is started a second time; it doubles up to the most. Set by hand."""

_HEALTHY_S = 10.0
"""Seconds; a node that ran so long is started again at once. Set by hand."""

_LOOK_EVERY_S, _STOP_PATIENCE_S = 0.1, 5.0
"""Seconds between looks where there is no news, and until a node that does not end is killed."""


class NodeDiedError(DepthPoseError):
    """A node ended before it was ready; the message holds its last words."""


def sensor_names() -> list[str]:
    """Sensors that `up` and `Suite` know by name."""
    return sorted(p.stem for p in SENSORS_PATH.glob("*.yaml"))


@dataclass
class _Node:
    """A node, whichever process it is at the moment; times of `time.monotonic`, seconds."""

    name: str
    process: Child | None = None
    started_s: float = 0.0
    restarts: int = 0
    delay_s: float = 0.0
    retry_s: float | None = 0.0


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
        self._nodes = {name: _Node(name) for name in nodes}
        self._whole = set(nodes) == set(NODES)
        self._bank = str(Path(bank).absolute()) if bank is not None else ""
        self._server: ForkServer | None = None
        self._spare: Child | None = None
        self._failed: DepthPoseError | None = None
        self._news, self._stopping = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._supervise, name="supervisor", daemon=True)

    @property
    def restarts(self) -> dict[str, int]:
        """How often each node was started again."""
        return {name: node.restarts for name, node in self._nodes.items()}

    @property
    def failure(self) -> DepthPoseError | None:
        """Why the suite cannot go on, if so."""
        return self._failed

    def pid(self, name: str) -> int | None:
        """Process id of a node, the "spare" or the "fork server"; None while it is down."""
        process = self._process(name)
        return process.pid if process is not None and not process.ended.is_set() else None

    def is_ready(self, name: str) -> bool:
        """Whether it has said so since it was last started; the spare could then take over at once."""
        process = self._process(name)
        return process is not None and process.is_ready

    def _process(self, name: str) -> Child | None:
        others = {"spare": self._spare, "fork server": self._server}
        return others[name] if name in others else self._nodes[name].process

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
        for name, node in self._nodes.items():
            while not self.is_ready(name):
                if self._failed is not None:
                    raise self._failed
                if time.monotonic() > deadline_s:
                    what = f"the {name} was not ready in {timeout_s:.0f} s"
                    raise NodeDiedError(_with_last_words(what, node.process or self._server))
                time.sleep(0.02)

    def stop(self) -> dict[str, int]:
        """End all nodes; gives their exit codes, 0 where they ended cleanly."""
        self._stopping.set()
        self._news.set()
        if self._thread.ident is not None:
            self._thread.join()
        running = {name: node.process for name, node in self._nodes.items() if node.process is not None}
        ending = [*running.values(), *([self._spare] if self._spare is not None else [])]
        for process in ending:
            process.end()
        deadline_s = time.monotonic() + _STOP_PATIENCE_S
        for process in ending:
            process.wait(deadline_s)
        if self._server is not None:
            self._server.close()
        remove_leftovers()
        return {name: process.wait(deadline_s) for name, process in running.items()}

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
            while not self._stopping.is_set():
                server = self._running_server()
                if server.is_ready:
                    for node in self._nodes.values():
                        self._look_after(node, server)
                    self._look_after_spare(server)
                self._news.wait(_LOOK_EVERY_S)
                self._news.clear()
        except DepthPoseError as e:
            self._failed = e
        except Exception:
            self._failed = DepthPoseError(f"the supervisor failed:\n{traceback.format_exc()}")

    def _running_server(self) -> ForkServer:
        """Give the fork server; start it where it does not run."""
        server = self._server
        if server is not None and server.ended.is_set():
            server.close()
            if not server.ready.is_set():
                raise NodeDiedError(_with_last_words(f"the {server.name} ended", server))
            self._sink(f"[{server.name}] ended with code {server.code}; starting it again")
        if server is None or server.ended.is_set():
            server = self._server = ForkServer(self._bank, _environment(), self._sink, self._news)
        return server

    def _look_after(self, node: _Node, server: ForkServer) -> None:
        """Start a node again once it has ended, at once or after its delay."""
        now_s, process = time.monotonic(), node.process
        if process is not None and process.ended.is_set() and node.retry_s is None:
            code = process.wait(now_s)
            if code == EXIT_CONFIG or (not process.ready.is_set() and node.restarts == 0):
                what = f"the {node.name} ended with code {code} before it was ready"
                raise (ConfigError if code == EXIT_CONFIG else NodeDiedError)(_with_last_words(what, process))
            if now_s - node.started_s > _HEALTHY_S:
                node.delay_s = 0.0
            after = f"in {node.delay_s:.1f} s" if node.delay_s else "at once"
            self._sink(f"[{node.name}] ended with code {code}; starting it again {after}")
            node.retry_s = now_s + node.delay_s
            node.delay_s = min(max(_FIRST_DELAY_S, 2.0 * node.delay_s), _MAX_DELAY_S)
        if node.retry_s is not None and now_s >= node.retry_s:
            node.restarts += process is not None
            node.retry_s, node.started_s = None, now_s
            node.process = self._spawn(node.name, server)

    def _spawn(self, name: str, server: ForkServer) -> Child:
        """Have the spare, or a new process, become a node."""
        spare = self._spare
        if spare is not None and spare.is_ready:
            process, self._spare = spare, None
        else:
            process = server.fork()
        consumers = _CONSUMERS[name] if self._whole else 0
        own = ["-p", f"consumers:={consumers}", "-p", f"producers:={_yaml(self._whole)}"]
        process.become(name, ["--ros-args", *own, *self._arguments])
        return process

    def _look_after_spare(self, server: ForkServer) -> None:
        """Fork a spare once all nodes are ready, so that it takes no time from their start."""
        if self._spare is not None and self._spare.ended.is_set():
            self._spare = None
        if self._spare is None and all(map(self.is_ready, self._nodes)):
            remove_leftovers()
            self._spare = server.fork()


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
        if not told and all(map(suite.is_ready, NODES)):
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
        if sensor not in sensor_names():
            raise ConfigError(f"no sensor {sensor!r} is known; there are {', '.join(sensor_names())}")
        arguments += ["--params-file", str(SENSORS_PATH / f"{sensor}.yaml")]
    if params_file is not None:
        if not Path(params_file).is_file():
            raise ConfigError(f"no parameter file {params_file}")
        arguments += ["--params-file", str(params_file)]
    values = dict(parameters) | ({"bank": str(Path(bank).absolute())} if bank is not None else {})
    for name, value in values.items():
        arguments += ["-p", f"{name}:={_yaml(value)}"]
    return arguments


def _yaml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, int | float) else f"'{value}'"


def _with_last_words(what: str, process: Child | None) -> str:
    said = "\n".join(process.last_lines) if process is not None else ""
    return f"{what}:\n{said or 'it said nothing'}"


def _environment() -> dict[str, str]:
    """Give the processes' environment: a process with threads of its own cannot fork."""
    return {**os.environ, "PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def _print(line: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        print(line, flush=True)
