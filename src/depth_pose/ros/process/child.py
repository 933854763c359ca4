"""One of the processes, as the supervisor sees it: what it says, and whether it lives."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path

from depth_pose.ros.process import BEAT, DONE, HOST, PID, READY, SECOND_HOST

PATIENCE_S = 3.0
"""Seconds without a sign of life after which a process counts as hung.

Twenty busy programs on two cores made the longest silence 0.5 s. With a spare, which takes over in half a
second, a hung node is replaced within 5 s.
"""

_SUSPECT_S = 1.0
"""Seconds of silence from which on it is asked whether the process could have said something; set by hand."""

_TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")
"""Of the processor time in Linux' /proc/PID/stat."""


class Child:
    """A process at the other end of a connection.

    Attributes
    ----------
    name : str
    pid, code : int or None
        Process id, once it is there; exit code, once it has ended: 0 also where it had done its work and was
        killed.
    ready_s : float
        When it said that it is ready, by the monotonic clock; before that infinity.
    silent_s : float
        Seconds since its last sign of life, without those that it waited for a processor.
    last_lines : deque of str
        What it has printed last.
    """

    def __init__(self, name: str) -> None:
        self.name, self.ready_s, self.silent_s = name, math.inf, 0.0
        self.pid: int | None = None
        self.code: int | None = None
        self.last_lines, self._rest = deque[str](maxlen=20), b""
        self._ran_s, self._doomed, self._is_done = 0.0, False, False
        self._socket, self._theirs = socket.socketpair()

    def fileno(self) -> int:
        """Give the connection, for who waits for news."""
        return self._socket.fileno()

    def spawn(self, command: Sequence[str], environment: dict[str, str]) -> None:
        """Start a program; Ctrl-C does not reach it."""
        with self._theirs as end:
            fd = end.fileno()
            program = subprocess.Popen(
                command, stdin=fd, stdout=fd, stderr=fd, env=environment, start_new_session=True
            )
        self.pid, program.returncode = program.pid, 0  # `read` waits for it, as for those that are forked

    def fork(self, host: Child, arguments: Sequence[str]) -> None:
        """Have a host fork it; where that is gone, this one has ended, too."""
        with self._theirs as end, contextlib.suppress(OSError):
            socket.send_fds(host._socket, [json.dumps([self.name, arguments]).encode()], [end.fileno()])

    def become(self, name: str, arguments: Sequence[str]) -> None:
        """Have a spare become a node, or a second host the host; where it died just now, it ends."""
        self.name = name
        if name != HOST:
            self.ready_s = math.inf
            with contextlib.suppress(OSError):
                self._socket.sendall(json.dumps([name, arguments]).encode() + b"\n")

    def read(self, sink: Callable[[str], None]) -> None:
        """Hand on what it has printed, with its name in front; or note that it has ended."""
        data = b""
        with contextlib.suppress(ConnectionError):
            data = self._socket.recv(1 << 16)
        lines = (self._rest + data.replace(BEAT, b"")).split(b"\n")
        self._rest = lines.pop() if data or not lines[-1] else b""
        for line in (raw.decode(errors="replace") for raw in lines):
            if self.pid is None and line.startswith(PID):  # its first line, and no other
                self.pid = int(line[1:])
                continue
            if DONE in line:
                self._is_done = True
                continue
            self.last_lines.append(line)
            if READY in line:
                self.ready_s = min(self.ready_s, time.monotonic())
            sink(f"[{self.name}] {line}")
        if data:
            self.silent_s = 0.0
            return
        self._socket.close()
        self.code = -signal.SIGKILL  # with its host, before it was there
        with contextlib.suppress(ChildProcessError):
            if self.pid is not None:
                self.code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        if self._is_done and self.code == -signal.SIGKILL:
            sink(f"[{self.name}] had done its work, but did not end; it was killed")
            self.code = 0

    def end(self) -> None:
        """Ask it to end, by the end of its connection; a host, which may be loading, is not asked."""
        if self.name in (HOST, SECOND_HOST):
            self.kill()
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)

    def kill(self) -> None:
        """End it at once, as far as it is known."""
        if self.code is None and self.pid is not None:
            os.kill(self.pid, signal.SIGKILL)

    def kill_if_hung(self, waited_s: float, sink: Callable[[str], None]) -> None:
        """End a process that gives no sign of life though it could, once it was ready; another follows it."""
        if self.silent_s > _SUSPECT_S:
            waited_s = min(waited_s, self._could_run_s())
        self.silent_s += waited_s
        if self.silent_s > PATIENCE_S and self.ready_s < math.inf and self.code is None and not self._doomed:
            sink(f"[{self.name}] gave no sign of life for {PATIENCE_S:.1f} s; it is killed")
            self._doomed = True  # on a busy machine its end takes a while
            self.kill()

    def _could_run_s(self) -> float:
        """Say how long it could run since it was last asked: not while all processors were others'."""
        now_s, wants_to = self._ran_s, False
        with contextlib.suppress(OSError):  # it has ended, or a thread of it
            process = Path(f"/proc/{self.pid}")
            now_s = sum(map(int, _stat(process)[11:13])) / _TICKS_A_SECOND
            wants_to = any(_stat(thread)[0] == "R" for thread in (process / "task").iterdir())
        ran_s, self._ran_s = now_s - self._ran_s, now_s
        return ran_s if wants_to else math.inf


def _stat(of: Path) -> list[str]:
    """Give what Linux says of a process or thread, from its state on; user and system time are 11 and 12."""
    return (of / "stat").read_text().rpartition(")")[2].split()
