"""Start the four nodes, keep them running, end them together.

`Suite` is a context manager for programs and tests::

    with Suite(bank="bank.npz") as suite:   # returns when all four are ready
        ...                                 # topics are live
                                            # all four have ended here

`up` is the same as a command that runs until SIGINT or SIGTERM. Each node is a process, forked from one
that has everything loaded, the host (`depth_pose.ros.process.host`), which also starts again a node that
dies: at once at first, and up to 10 s later when it goes on dying. One more process is forked as a spare,
which takes the place of a node that dies. A node's output appears with its name in front. If the host dies,
so do the nodes, and all are started again; if the supervisor is killed, all end.
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
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.ros import PRIVATE_UMASK, stay_local
from depth_pose.ros.process import EVENT, NODES
from depth_pose.ros.process.runner import on_stop

__all__ = ["NODES", "SENSORS_PATH", "NodeDiedError", "Suite", "sensor_names", "up"]

SENSORS_PATH = Path(__file__).parents[1] / "sensors"
"""Parameter files of known sensor drivers, NAME.yaml."""

_STOP_PATIENCE_S = 8.0
"""Seconds until a host that does not end is killed; it gives its nodes less. Set by hand."""


_KILLED = -signal.SIGKILL
"""Exit code of a node whose host was killed."""


class NodeDiedError(DepthPoseError):
    """A node ended before it was ready; the message holds its last words."""


def sensor_names() -> list[str]:
    """Sensors that `up` and `Suite` know by name."""
    return sorted(p.stem for p in SENSORS_PATH.glob("*.yaml"))


class _State(NamedTuple):
    """What the host tells of a process."""

    pid: int | None = None
    is_ready: bool = False
    restarts: int = 0
    code: int | None = None


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
        self._job = json.dumps({
            "bank": str(Path(bank).absolute()) if bank is not None else "",
            "nodes": list(nodes),
            "arguments": _ros_arguments(params_file, sensor, bank, parameters or {}, remap),
        })  # fmt: skip
        self._names, self._sink = tuple(nodes), sink or _print
        self._states: dict[str, _State] = {}
        self._host: subprocess.Popen[str] | None = None
        self._hosts_died, self._last_lines = 0, deque[str](maxlen=20)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="supervisor", daemon=True)

    @property
    def restarts(self) -> dict[str, int]:
        """How often each node was started again."""
        return {n: self._hosts_died + self._state(n).restarts for n in self._names}

    def pid(self, name: str) -> int | None:
        """Process id of a node, of the "spare" or of the "host"; None while it is down."""
        if name == "host":
            return self._host.pid if self._host is not None and self._host.poll() is None else None
        return self._state(name).pid if self._state(name).code is None else None

    def is_ready(self, name: str) -> bool:
        """Whether a node has said so since it was last started; the spare could then take over at once."""
        return self._state(name).is_ready and self._state(name).code is None

    def _state(self, name: str) -> _State:
        return self._states.get(name, _State())

    def start(self) -> None:
        """Start all nodes; returns at once, see `wait_ready`."""
        if self._thread.ident is not None:
            raise DepthPoseError("this suite has been started; make a new one")
        self._host = self._start_host()
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
        for name in self._names:
            while not self.is_ready(name):
                if self.failure is not None:
                    raise self.failure
                if time.monotonic() > deadline_s:
                    raise self._with_last_words(f"the {name} was not ready in {timeout_s:.0f} s")
                time.sleep(0.02)

    def stop(self) -> dict[str, int]:
        """End all nodes; gives their exit codes, 0 where they ended cleanly."""
        self._stopping.set()
        deadline_s = time.monotonic() + _STOP_PATIENCE_S
        while self._host is not None and self._thread.is_alive():
            late = time.monotonic() > deadline_s
            self._host.kill() if late else self._host.terminate()
            self._thread.join(0.5)
        return {n: _KILLED if s.code is None else s.code for n, s in self._states.items() if n in self._names}

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

    def _start_host(self) -> subprocess.Popen[str]:
        # a process with threads of its own cannot fork; Ctrl-C reaches the supervisor only
        alone = {"PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        return subprocess.Popen(
            [sys.executable, "-W", "ignore:This process", "-m", "depth_pose.ros.process.host", self._job],
            stdin=subprocess.PIPE,  # closed by our death, which ends the host
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env=os.environ | alone,
            umask=PRIVATE_UMASK,  # other accounts may not read the shared memory
            start_new_session=True,
        )

    def _follow(self) -> None:
        """Read what the host says, in a thread of its own; start it again where it was killed."""
        while self._host is not None:
            self._last_lines.clear()
            with self._host as host:
                for line in host.stdout or ():
                    if line.startswith(EVENT):
                        self._take(json.loads(line[1:]))
                    else:
                        self._last_lines.append(line.rstrip("\n"))
                        self._sink(self._last_lines[-1])
            code = host.returncode
            if self._stopping.is_set() or self.failure is not None:
                return
            if not self._states:
                self.failure = self._with_last_words(f"the host ended with code {code} while it loaded")
                return
            self._sink(f"[host] ended with code {code}; starting it and all nodes again")
            self._hosts_died, self._states = self._hosts_died + 1, {}
            self._host = self._start_host()

    def _with_last_words(self, what: str) -> NodeDiedError:
        return NodeDiedError("\n".join([f"{what}:", *(self._last_lines or ["nothing was said"])]))

    def _take(self, event: dict[str, Any]) -> None:
        if "processes" in event:
            self._states = {name: _State(*state) for name, state in event["processes"].items()}
        else:
            self.failure = (ConfigError if event["refused"] else NodeDiedError)(event["why"])


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
    with contextlib.suppress(BrokenPipeError):
        print(line, flush=True)
