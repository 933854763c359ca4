"""The supervisor's side of the fork server: start it, have it fork, look after what it forked.

Forked processes are the fork server's children, not the supervisor's. Their ends are seen through
process file descriptors, which work for any process, so that they outlive a fork server that dies;
only their exit codes are then not known.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import IO

from depth_pose.core.errors import DepthPoseError

UNKNOWN_CODE = -signal.SIGKILL
"""Exit code of a process whose fork server ended before it."""

_CODE_PATIENCE_S = 1.0


class ServerDiedError(DepthPoseError):
    """The fork server ended."""


class ForkedProcess:
    """A process that a fork server forked; what `subprocess.Popen` has of that name, it does here.

    Attributes
    ----------
    pid : int
    stdin, stdout : text files
        Pipes to its standard input, and from its output and errors.
    """

    def __init__(self, server: ForkServer, pid: int, stdin: IO[str], stdout: IO[str]) -> None:
        self.pid, self.stdin, self.stdout = pid, stdin, stdout
        self.code: int | None = None
        self._server = server
        self._handle = os.pidfd_open(pid)

    def __del__(self) -> None:
        with contextlib.suppress(OSError, AttributeError):
            self.stdin.close()
            os.close(self._handle)

    @property
    def is_running(self) -> bool:
        """Whether it has not ended; may be asked from any thread."""
        return not select.select([self._handle], [], [], 0.0)[0]

    def poll(self) -> int | None:
        """Exit code, None while it runs."""
        if self.code is None and not self.is_running:
            deadline = time.monotonic() + _CODE_PATIENCE_S
            while self.code is None and self._server.listen(0.05) and time.monotonic() < deadline:
                pass
            if self.code is None:
                self.code = UNKNOWN_CODE
        return self.code

    def send_signal(self, number: int) -> None:
        """Send a signal, if it still runs."""
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._handle, number)

    def wait(self, deadline: float) -> int:
        """Wait for the end until `time.monotonic` is `deadline`, then enforce it; gives the exit code."""
        if not select.select([self._handle], [], [], max(0.1, deadline - time.monotonic()))[0]:
            self.send_signal(signal.SIGKILL)
            select.select([self._handle], [], [])
        code = self.poll()
        assert code is not None
        return code


class ForkServer:
    """A process of `depth_pose.ros.process.forkserver`; to be used from one thread at a time.

    Parameters
    ----------
    bank : str
        Bank to load ahead; empty for the set-up's.
    environment : mapping
        Of it and of all that it forks.

    Attributes
    ----------
    process : subprocess.Popen
        The server itself; its output is not read here.
    """

    def __init__(self, bank: str, environment: Mapping[str, str]) -> None:
        self._link, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._open = True
        self._running: dict[int, ForkedProcess] = {}
        self._born: ForkedProcess | None = None
        with other:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "depth_pose.ros.process.forkserver", str(other.fileno()), bank],
                pass_fds=[other.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                bufsize=1,
                start_new_session=True,  # Ctrl-C reaches the supervisor only
                env=dict(environment),
            )

    def fork(self) -> ForkedProcess:
        """Fork a process that waits for its role; returns when the server has loaded and has done so.

        Raises
        ------
        ServerDiedError
            If the server has ended.
        """
        stdin_read, stdin_write = os.pipe()
        stdout_read, stdout_write = os.pipe()
        stdin, stdout = open(stdin_write, "w"), open(stdout_read, errors="replace")  # noqa: SIM115
        try:
            socket.send_fds(self._link, [b"fork"], [stdin_read, stdout_write])
        except OSError:
            self._open = False
        finally:
            os.close(stdin_read)
            os.close(stdout_write)
        self._pipes, self._born = (stdin, stdout), None
        while self._born is None:
            if not self.listen(1.0):
                raise ServerDiedError(f"the fork server ended with code {self.process.poll()}")
        return self._born

    def listen(self, timeout_s: float) -> bool:
        """Take the next news of what was forked, or wait that long; False if the server has ended."""
        if not self._open:
            time.sleep(timeout_s)
            return False
        if not select.select([self._link], [], [], timeout_s)[0]:
            return True
        try:
            said = self._link.recv(64)
        except OSError:
            said = b""
        if not said:
            self._open = False
            return False
        pid, code = json.loads(said)
        if code is None:
            self._born = self._running[pid] = ForkedProcess(self, pid, *self._pipes)
        else:
            self._running.pop(pid).code = code
        return True

    def close(self) -> None:
        """End the server; what it forked goes on."""
        self._open = False
        self._link.close()
        try:
            self.process.wait(2.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
