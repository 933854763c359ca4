"""A process as its supervisor knows it: what it says, whether it is ready, that it ended."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from depth_pose.ros.process.names import EXIT_CODE, LOADED, PROCESS_ID, READY, WAITS

KILLED = -signal.SIGKILL
"""Exit code of a process that could not say its own."""

Sink = Callable[[str], None]


class Child:
    """A process with one socket for standard input, output and errors.

    Parameters
    ----------
    name, word : str
        What it is called in front of its lines; what it prints when it is ready.
    sink : callable
        Gets its lines.
    news : threading.Event
        Set when it becomes ready or ends.

    Attributes
    ----------
    pid, code : int or None
        Process id, exit code; None before they are known.
    ready, ended : threading.Event
    last_lines : deque of str
    """

    def __init__(self, name: str, word: str, sink: Sink, news: threading.Event) -> None:
        self.name = name
        self.pid: int | None = None
        self.code: int | None = None
        self.ready, self.ended = threading.Event(), threading.Event()
        self.last_lines: deque[str] = deque(maxlen=20)
        self._word, self._sink, self._news = word, sink, news
        self._socket, self._theirs = socket.socketpair()

    @property
    def is_ready(self) -> bool:
        """Whether it has said so, and runs."""
        return self.ready.is_set() and not self.ended.is_set()

    def become(self, name: str, arguments: Sequence[str]) -> None:
        """Have a forked process become a node; where it died just now, it says so by its end."""
        self.name, self._word = name, READY
        self.ready.clear()
        with contextlib.suppress(OSError):
            self._socket.sendall(json.dumps([name, arguments]).encode() + b"\n")

    def end(self) -> None:
        """Ask it to end."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)

    def wait(self, deadline_s: float) -> int:
        """Wait for the end until `time.monotonic` is ``deadline_s``, then enforce it; gives the code."""
        if not self.ended.wait(max(0.1, deadline_s - time.monotonic())) and self.pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
            self.ended.wait(1.0)
        return KILLED if self.code is None else self.code

    def _follow(self) -> None:
        """Read what it prints, in a thread of its own; the process holds the socket's other end now."""
        self._theirs.close()
        threading.Thread(target=self._read, name=self.name, daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(OSError), self._socket.makefile(errors="replace") as lines:
            for line in lines:
                self._take(line.rstrip("\n"))
        self._socket.close()
        self.ended.set()
        self._news.set()

    def _take(self, line: str) -> None:
        if line.startswith(PROCESS_ID):
            self.pid = int(line.removeprefix(PROCESS_ID))
        elif line.startswith(EXIT_CODE):
            self.code = int(line.removeprefix(EXIT_CODE))
        else:
            self.last_lines.append(line)
            if line not in (LOADED, WAITS):
                self._sink(f"[{self.name}] {line}")
            if self._word in line:
                self.ready.set()
                self._news.set()


class ForkServer(Child):
    """A process of `depth_pose.ros.process.forkserver`.

    Parameters
    ----------
    bank : str
        Bank to load ahead; empty for the set-up's.
    environment : mapping
        Of it and of all that it forks.
    """

    def __init__(self, bank: str, environment: Mapping[str, str], sink: Sink, news: threading.Event) -> None:
        super().__init__("fork server", LOADED, sink, news)
        standard = self._theirs.fileno()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "depth_pose.ros.process.forkserver", bank],
            stdin=standard,
            stdout=standard,
            stderr=standard,
            start_new_session=True,  # Ctrl-C reaches the supervisor only
            env=dict(environment),
        )
        self.pid = self._process.pid
        self._follow()

    def fork(self) -> Child:
        """Fork a process that waits to become a node; where the server died, it ends at once."""
        child = Child("spare", WAITS, self._sink, self._news)
        with contextlib.suppress(OSError):
            socket.send_fds(self._socket, [b"f"], [child._theirs.fileno()])
        child._follow()
        return child

    def close(self) -> None:
        """End the server; what it forked goes on."""
        self.end()
        self.wait(time.monotonic() + (2.0 if self.is_ready else 0.0))
        self._process.wait()
