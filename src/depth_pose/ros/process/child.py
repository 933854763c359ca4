"""One of the processes, as the supervisor sees it: what it says, whether it lives, when it is due again."""

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

from depth_pose.ros.process import BEAT, HOST, PID, READY

PATIENCE_S = 3.0
"""Seconds without a sign of life after which a process counts as hung.

Twenty busy programs on two cores made the longest silence 0.5 s. With the spare, which takes over in half a
second, a hung node is replaced within 5 s.
"""

LONGEST_LOOK_S = 0.5
"""Seconds that one look can add to a silence: a machine that was itself paused proves nothing."""

_FIRST_DELAY_S, _MAX_DELAY_S = 0.1, 10.0
"""Seconds before a process is started again that died young twice; it doubles up to the most. Set by hand."""

_HEALTHY_S = 1.5
"""Seconds; a process that was ready so long before its last sign of life is started again at once.

What a bug or a frame ends, it ends while it loads or with its first frames. One that lived a little longer
each time would cost 0.08 of a core: 0.2 s of processor time each (matcher, killed six times, 1.6 s after it
was ready).
"""


class Child:
    """A process at the other end of a connection.

    Attributes
    ----------
    name : str
    pid, code : int or None
        Process id, once it is there; exit code, once it has ended.
    is_ready : bool
        Whether it has said so.
    restarts : int
        How often the process of this name was started again.
    retry_s : float
        When another may be started, by the monotonic clock.
    """

    def __init__(self, name: str) -> None:
        self._program: subprocess.Popen[bytes] | None = None
        self.pid: int | None = None
        self.code: int | None = None
        self._last_lines, self._rest = deque[str](maxlen=20), b""
        self.restarts, self.retry_s, self._delay_s = 0, 0.0, 0.0
        self._silent_s, self._hung_s, self._looked_s = 0.0, 0.0, time.monotonic()
        self.socket, self.theirs = socket.socketpair()
        self._take_name(name)

    def _take_name(self, name: str) -> None:
        self.name, self.is_ready, self._ready_s = name, False, math.inf

    @classmethod
    def spawned(cls, name: str, command: Sequence[str], environment: dict[str, str]) -> Child:
        """Start a program; Ctrl-C does not reach it."""
        child = cls(name)
        with child.theirs as end:
            child._program = subprocess.Popen(
                command,
                stdin=end.fileno(),
                stdout=end.fileno(),
                stderr=end.fileno(),
                env=environment,
                start_new_session=True,
            )
        child.pid = child._program.pid
        return child

    @classmethod
    def forked(cls, name: str, arguments: Sequence[str], host: Child) -> Child:
        """Have a host fork a process; where that is gone, this one has ended, too."""
        child = cls(name)
        with child.theirs as end, contextlib.suppress(OSError):
            socket.send_fds(host.socket, [json.dumps([name, arguments]).encode()], [end.fileno()])
        return child

    def follow(self, last: Child) -> None:
        """Take the place of one that has ended."""
        self.restarts, self._delay_s = last.restarts + 1, last._delay_s

    def become(self, name: str, arguments: Sequence[str]) -> None:
        """Have a spare become a node, or a second host the host; where it died just now, it ends."""
        if name == HOST:
            self.name = name
            return
        self._take_name(name)
        with contextlib.suppress(OSError):
            self.socket.sendall(json.dumps([name, arguments]).encode() + b"\n")

    def read(self, sink: Callable[[str], None]) -> None:
        """Hand on what it has printed, with its name in front; or note that it has ended."""
        data = b""
        with contextlib.suppress(ConnectionError):
            data = self.socket.recv(1 << 16)
        self._silent_s = 0.0
        lines = (self._rest + data.replace(BEAT, b"")).split(b"\n")
        self._rest = lines.pop() if data or not lines[-1] else b""
        for line in (raw.decode(errors="replace") for raw in lines):
            if line.startswith(PID):
                self.pid = int(line[1:])
                continue
            self._last_lines.append(line)
            if READY in line and not self.is_ready:
                self.is_ready, self._ready_s = True, time.monotonic()
            sink(f"[{self.name}] {line}")
        if not data:
            self.code = self._exit_code()

    def _exit_code(self) -> int:
        if self._program is not None:
            return self._program.wait()
        with contextlib.suppress(ChildProcessError):
            if self.pid is not None:
                return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return -signal.SIGKILL  # with its host, before it was there

    @property
    def last_words(self) -> str:
        """What it has printed last."""
        return "\n".join(self._last_lines) or "it said nothing"

    def end(self) -> None:
        """Ask it to end, by the end of its connection; a host that loads does not look at that."""
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_WR)
            if self.name == HOST and self.pid is not None:
                os.kill(self.pid, signal.SIGTERM)

    def kill(self) -> None:
        """End it at once, as far as it is known."""
        if self.code is None and self.pid is not None:
            os.kill(self.pid, signal.SIGKILL)

    def kill_if_hung(self, sink: Callable[[str], None]) -> None:
        """End a process that gives no sign of life once it was ready; its end brings another."""
        now_s = time.monotonic()
        self._silent_s += min(now_s - self._looked_s, LONGEST_LOOK_S)
        self._looked_s = now_s
        if self.is_ready and self._silent_s > PATIENCE_S:
            sink(f"[{self.name}] gave no sign of life for {PATIENCE_S:.1f} s; it is killed")
            self._hung_s = self._silent_s  # the end of its connection is a sign, too
            self.kill()

    def plan_retry(self, sink: Callable[[str], None]) -> None:
        """Have another started: at once, or ever later where one after the other dies young."""
        now_s = time.monotonic()
        wait_s = self._delay_s if now_s - self._hung_s - self._ready_s < _HEALTHY_S else 0.0
        after = f"in {wait_s:.1f} s" if wait_s else "at once"
        sink(f"[{self.name}] ended with code {self.code}; starting it again {after}")
        self.retry_s, self._delay_s = now_s + wait_s, min(max(_FIRST_DELAY_S, 2.0 * wait_s), _MAX_DELAY_S)
