"""The process that loads everything once, forks the nodes, and starts again those that die.

Imports, compiled kernels and the bank are most of a node's start. A node that is forked from here starts
at once, and shares this memory until it writes to it. A fork takes only one thread along, so rclpy is
imported here, and never initialised. (The import starts two threads of LTTng, the tracer: forked nodes
cannot be traced.) The host ends on SIGTERM and with its supervisor, the nodes end with the host.

Measured against this (2 cores, busy): plain processes take 15 s instead of 6 s to start, 1.7 to 2.5 s
instead of 0.4 s to replace a node, and 804 MB instead of 550 MB. Without the spare a node is back after
0.5 to 1.8 s: joining the ROS graph takes long on the ports of a process that was killed just now.
"""

from __future__ import annotations

import contextlib
import faulthandler
import fcntl
import gc
import importlib
import json
import os
import selectors
import signal
import socket
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from depth_pose.ros.process import EVENT, NODES, READY
from depth_pose.ros.process.pulse import PATIENCE_S, Pulse
from depth_pose.ros.process.runner import EXIT_CONFIG, end_with_parent, leave

_CONSUMERS = {"denoise": 3, "matcher": 1, "refine": 1, "recovery": 1}
"""Nodes of the suite that subscribe to what each publishes; it is ready once they have."""

_FIRST_DELAY_S, _MAX_DELAY_S = 0.1, 10.0
"""Seconds before a node is started a second time; it doubles up to the most. Set by hand."""

_HEALTHY_S = 10.0
"""Seconds; a node that ran so long is started again at once. Set by hand."""

_LOOK_EVERY_S, _STOP_PATIENCE_S = 0.1, 5.0
"""Seconds between looks where there is no news, and until a node that does not end is killed."""

_SHARED_MEMORY, _YOUNG_S = Path("/dev/shm"), 0.5
"""Where Fast DDS keeps its segments; a lock file younger than this, in seconds, may yet be locked."""


class _Process:
    """A forked process: a node; or, without arguments, the spare, which joins the ROS graph and waits."""

    def __init__(self, name: str, arguments: list[str] | None) -> None:
        self.code: int | None = None
        self.restarts, self.delay_s, self.retry_s = 0, 0.0, 0.0
        self.last_lines, self._rest = deque[str](maxlen=20), b""
        self.socket, theirs = socket.socketpair()
        self.pulse = Pulse()
        self._take_name(name)
        host = os.getpid()
        self.pid = os.fork()
        if self.pid == 0:
            for standard in range(3):
                os.dup2(theirs.fileno(), standard)
            end_with_parent()
            self.pulse.start()
            leave(_run(name, arguments) if os.getppid() == host else 0)
        theirs.close()

    def _take_name(self, name: str) -> None:
        self.name, self._started_s, self.is_ready = name, time.monotonic(), False

    def become(self, name: str, arguments: list[str]) -> None:
        """Have the spare become a node; where it died just now, it says so by its end."""
        self._take_name(name)
        with contextlib.suppress(OSError):
            self.socket.sendall(json.dumps([name, arguments]).encode() + b"\n")

    def read(self) -> None:
        """Print on what it has printed, with its name in front; or note that it has ended."""
        data = b""
        with contextlib.suppress(ConnectionError):
            data = self.socket.recv(1 << 16)
        lines = (self._rest + data).split(b"\n")
        self._rest = lines.pop() if data or not lines[-1] else b""
        for line in lines:
            self.last_lines.append(line.decode(errors="replace"))
            self.is_ready = self.is_ready or READY in self.last_lines[-1]
            _say(f"[{self.name}] {self.last_lines[-1]}")
        if not data:
            self.code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])

    def kill_if_hung(self) -> None:
        """End a process that gives no sign of life once it was ready; its end brings another."""
        if self.code is None and self.pulse.silent_s() > PATIENCE_S and self.is_ready:
            _say(f"[{self.name}] gave no sign of life for {PATIENCE_S:.1f} s; it is killed")
            os.kill(self.pid, signal.SIGKILL)

    def plan_retry(self) -> None:
        """Start a node that has ended again: at once at first, ever later where it goes on dying."""
        now_s = time.monotonic()
        wait_s = self.delay_s if now_s - self._started_s < _HEALTHY_S else 0.0
        after = f"in {wait_s:.1f} s" if wait_s else "at once"
        _say(f"[{self.name}] ended with code {self.code}; starting it again {after}")
        self.retry_s, self.delay_s = now_s + wait_s, min(max(_FIRST_DELAY_S, 2.0 * wait_s), _MAX_DELAY_S)


def _run(name: str, arguments: list[str] | None) -> int:
    """Be a node, in a forked process; gives its exit code."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    joined = None
    try:
        if arguments is None:
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            name = f"spare_{os.getpid()}"
            joined = rclpy.create_node(
                name, namespace="depth_pose", enable_rosout=False, start_parameter_services=False
            )
            print(f"{joined.get_name()} {READY} to become a node", flush=True)
            line = sys.stdin.readline() or sys.exit(0)  # the host is gone
            name, arguments = json.loads(line)
        return _main(name)(arguments)
    except SystemExit:  # told to stop before it was a node
        if joined is not None:
            joined.destroy_node()  # else shared memory would be left behind
        rclpy.try_shutdown()
        return 0
    except Exception:
        traceback.print_exc()
        return 1


def _main(name: str) -> Callable[[list[str]], int]:
    main: Callable[[list[str]], int] = importlib.import_module(f"depth_pose.ros.nodes.{name}_node").main
    return main


class _Host:
    """Keeps the nodes running until it is told to stop; ``arguments`` are each node's."""

    def __init__(self, arguments: dict[str, list[str]]) -> None:
        self._arguments, self._pid, self._is_stopping = arguments, os.getpid(), False
        self._processes: dict[str, _Process] = {}
        self._told: dict[str, Any] = {}
        self._selector = selectors.DefaultSelector()
        self._selector.register(sys.stdin, selectors.EVENT_READ)
        signal.signal(signal.SIGTERM, self._stop)

    def run(self) -> None:
        """Start the nodes, and watch them; returns when all have ended."""
        while not self._is_stopping:
            for name in self._arguments:
                self._look_after(name)
            if "spare" not in self._processes and all(p.is_ready for p in self._processes.values()):
                self._start("spare", None)
            self._look()
        self._kill(signal.SIGTERM)
        deadline_s = time.monotonic() + _STOP_PATIENCE_S
        while any(p.code is None for p in self._processes.values()):
            self._look()
            if time.monotonic() > deadline_s:
                self._kill(signal.SIGKILL)
        _remove_leftovers()
        self._tell_state()

    def _stop(self, *_: object) -> None:
        if os.getpid() != self._pid:
            sys.exit(0)  # a process that has no handler of its own yet
        self._is_stopping = True

    def _kill(self, number: int) -> None:
        for process in self._processes.values():
            if process.code is None:
                os.kill(process.pid, number)

    def _look_after(self, name: str) -> None:
        """Start a node; where it has ended, the spare takes its place if there is one."""
        last = self._processes.get(name)
        if last is not None and (last.code is None or time.monotonic() < last.retry_s):
            return
        spare = self._processes.get("spare")
        if last is not None and spare is not None and spare.is_ready:
            self._processes[name] = self._processes.pop("spare")
            spare.become(name, self._arguments[name])
        else:
            self._start(name, self._arguments[name])
        if last is not None:
            self._processes[name].restarts = last.restarts + 1
            self._processes[name].delay_s = last.delay_s

    def _start(self, name: str, arguments: list[str] | None) -> None:
        process = self._processes[name] = _Process(name, arguments)
        self._selector.register(process.socket, selectors.EVENT_READ, process)

    def _tell_state(self) -> None:
        """Tell the supervisor what has changed."""
        state = {n: (p.pid, p.is_ready, p.restarts, p.code) for n, p in self._processes.items()}
        if state != self._told:
            self._told = state
            _say(EVENT + json.dumps({"processes": state}))

    def _look(self) -> None:
        """See to what comes, and to what does not."""
        self._tell_state()
        for process in self._processes.values():
            process.kill_if_hung()
        for key, _ in self._selector.select(_LOOK_EVERY_S):
            if key.data is not None:
                key.data.read()
            if key.data is None or key.data.code is not None:
                self._selector.unregister(key.fileobj)
                self._take_end(key.data)

    def _take_end(self, process: _Process | None) -> None:
        """See to the end of a process, or of the supervisor if None."""
        if process is None:
            self._is_stopping = True
            return
        process.socket.close()
        _remove_leftovers()
        if process.name == "spare":
            del self._processes["spare"]
        elif process.code == EXIT_CONFIG or (process.restarts == 0 and not process.is_ready):
            if not self._is_stopping:
                said = "\n".join(process.last_lines) or "it said nothing"
                why = f"the {process.name} ended with code {process.code} before it was ready:\n{said}"
                _say(EVENT + json.dumps({"refused": process.code == EXIT_CONFIG, "why": why}))
            self._is_stopping = True
        elif not self._is_stopping:
            process.plan_retry()


def _say(line: str) -> None:
    with contextlib.suppress(BrokenPipeError):  # the supervisor is gone
        print(line, flush=True)


def _remove_leftovers() -> None:
    """Remove the shared memory of processes that were killed.

    Fast DDS keeps 32 MiB of /dev/shm for each process, and beside it a lock file that the process holds
    as long as it lives (``fastdds shm clean`` does what is done here).
    """
    for lock in _SHARED_MEMORY.glob("fastrtps_*_el"):
        if "port" in lock.name:
            continue
        with contextlib.suppress(OSError), lock.open("r+b") as handle:  # else another user's, or gone
            if time.time() - lock.stat().st_mtime > _YOUNG_S:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails where the owner lives
                lock.with_name(lock.name.removesuffix("_el")).unlink(missing_ok=True)
                lock.unlink(missing_ok=True)


def load(bank: str) -> None:
    """Load all that nodes need; a bank's path, empty for the set-up's."""
    gc.disable()  # collections would take a sixth of the time
    from depth_pose.ros.process.warm_stages import make_ahead

    make_ahead(bank)
    for name in NODES:
        _main(name)
    gc.freeze()  # what is here stays; a collection that wrote to it would end the sharing
    gc.enable()


def main(job: str) -> None:
    """Load, then run the nodes until told to stop.

    Parameters
    ----------
    job : str
        JSON: ``bank``, ``nodes`` (their names) and ``arguments`` (of every node).
    """
    faulthandler.enable()  # a crash says where
    wanted = json.loads(job)
    is_whole = set(wanted["nodes"]) == set(NODES)
    load(wanted["bank"])
    arguments = {}
    for name in wanted["nodes"]:
        consumers = _CONSUMERS[name] if is_whole else 0
        own = ["-p", f"consumers:={consumers}", "-p", f"producers:={str(is_whole).lower()}"]
        arguments[name] = ["--ros-args", *own, *wanted["arguments"]]
    _Host(arguments).run()


if __name__ == "__main__":
    main(sys.argv[1])
