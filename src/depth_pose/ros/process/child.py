"""A node's process, as the supervisor sees it: its output and signs of life."""

from __future__ import annotations

import contextlib
import math
import os
import re
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from depth_pose.core.printable import printable
from depth_pose.ros.process import BEAT, DONE, READY

PATIENCE_S = 3.0
"""Seconds without a sign of life after which a process counts as hung.

Twenty busy programs on two cores made the longest silence 0.5 s. A new process takes less than 2 s, so that a
hung one is replaced within 5 s.
"""

_SUSPECT_S = 1.0
"""Seconds of silence after which it is checked whether the process could run."""

_TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")
"""Unit of the processor time in Linux' /proc/PID/stat."""


_COLOUR = re.compile("\x1b\\[[0-9;]*m")
"""Escape sequences that set colours (ECMA-48, SGR)."""


class Child:
    """A running program whose output is read.

    Parameters
    ----------
    name : str
        Prefix of each of its lines.
    command : sequence of str
    environment : mapping

    Attributes
    ----------
    pid : int
    code : int or None
        Exit code, once it has ended: 0 also if it was asked to end or had done its work when it was killed.
    ready_s : float
        Time when it reported ready, by the monotonic clock; infinity before that.
    silent_s : float
        Seconds since its last sign of life, without the time it waited for a processor.
    last_lines : deque of str
        Its last lines of output.
    """

    def __init__(self, name: str, command: Sequence[str], environment: Mapping[str, str]) -> None:
        self.name, self.ready_s, self.silent_s = name, math.inf, 0.0
        self.code: int | None = None
        self.last_lines, self._rest = deque[str](maxlen=20), b""
        self._ran_s, self._doomed, self._is_done, self._told_to_end = 0.0, False, False, False
        self._process = subprocess.Popen(  # in its own session, so that Ctrl-C does not reach it
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
            bufsize=0,
        )
        self.pid = self._process.pid

    @property
    def lived_s(self) -> float:
        """Seconds from ready to the last sign of life."""
        return time.monotonic() - self.silent_s - self.ready_s

    def fileno(self) -> int:
        """Return the file descriptor of its output, for `select`."""
        assert self._process.stdout is not None
        return self._process.stdout.fileno()

    def read(self, sink: Callable[[str], None]) -> None:
        """Forward its output, `printable` and prefixed with its name; or record that it has ended."""
        data = os.read(self.fileno(), 1 << 16)
        lines = (self._rest + data.replace(BEAT, b"")).split(b"\n")
        self._rest = lines.pop() if data or not lines[-1] else b""
        for line in map(_readable, lines):
            if line == f"{self.name} {DONE}":
                self._is_done = True
                continue
            self.last_lines.append(line)
            if f"{self.name} {READY}" in line:
                self.ready_s = min(self.ready_s, time.monotonic())
            sink(f"[{self.name}] {line}")
        if data:
            self.silent_s = 0.0
        else:
            self._take_end(sink)

    def _take_end(self, sink: Callable[[str], None]) -> None:
        assert self._process.stdout is not None
        self._process.stdout.close()
        self.code = self._process.wait()
        if self._is_done and self.code == -signal.SIGKILL:
            sink(f"[{self.name}] had done its work, but did not end; it was killed")
            self.code = 0
        if self._told_to_end and self.code == -signal.SIGTERM:  # while it loaded
            self.code = 0

    def end(self) -> None:
        """Ask it to end."""
        if self.code is None:
            self._told_to_end = True
            self._process.terminate()

    def kill(self) -> None:
        """End it at once."""
        if self.code is None:
            self._process.kill()

    def kill_if_hung(self, waited_s: float, sink: Callable[[str], None]) -> None:
        """Kill a process that was ready and gives no sign of life though it could run."""
        if self.silent_s > _SUSPECT_S:
            waited_s = min(waited_s, self._could_run_s())
        self.silent_s += waited_s
        if self.silent_s > PATIENCE_S and self.ready_s < math.inf and self.code is None and not self._doomed:
            sink(f"[{self.name}] gave no sign of life for {PATIENCE_S:.1f} s; it is killed")
            self._doomed = True  # on a busy machine the end takes a while
            self.kill()

    def _could_run_s(self) -> float:
        """Return how long it could run since the last call, without waiting for a processor."""
        now_s, wants_to = self._ran_s, False
        with contextlib.suppress(OSError):  # it has ended, or a thread of it
            process = Path(f"/proc/{self.pid}")
            now_s = sum(map(int, _stat(process)[11:13])) / _TICKS_A_SECOND
            wants_to = any(_stat(thread)[0] == "R" for thread in (process / "task").iterdir())
        ran_s, self._ran_s = now_s - self._ran_s, now_s
        return ran_s if wants_to else math.inf


def _readable(line: bytes) -> str:
    """Return a line of a process for printing; Fast DDS colours its own."""
    return printable(_COLOUR.sub("", line.decode(errors="surrogateescape")))


def _stat(of: Path) -> list[str]:
    """Return the fields of /proc/PID/stat from the state on; user and system time are 11 and 12."""
    return (of / "stat").read_text().rpartition(")")[2].split()
