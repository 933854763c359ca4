"""Real DDS, on a domain of its own and on this machine only, with hard time limits."""

import signal
import subprocess
import sys
import time

import pytest
from peer import LIMIT_S, Peer, join_own_domain

from depth_pose.ros.process import supervisor

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as in a shell's background job,
    signal.signal(signal.SIGINT, signal.default_int_handler)  # and so in all that the tests start


@pytest.fixture(autouse=True)
def domain(monkeypatch):
    return join_own_domain(monkeypatch)


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Nodes on a busy machine need longer than usual to end; who is killed for it ends with another code."""
    monkeypatch.setattr(supervisor, "_STOP_PATIENCE_S", LIMIT_S)


class Running:
    """A process, its output in a file; killed at the end of the test whatever happens."""

    def __init__(self, arguments, log_path):
        self._log_path = log_path
        with log_path.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, *arguments], stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL
            )

    @property
    def output(self):
        return self._log_path.read_text(errors="replace")

    def wait_for(self, text, timeout_s=LIMIT_S):
        deadline = time.monotonic() + timeout_s
        while text not in self.output:
            assert self.process.poll() is None, f"ended with {self.process.returncode}:\n{self.output}"
            assert time.monotonic() < deadline, f"no {text!r} in {timeout_s} s:\n{self.output}"
            time.sleep(0.02)

    def end(self, number, timeout_s=LIMIT_S):
        """Send a signal; give exit code and seconds it took."""
        started = time.monotonic()
        self.process.send_signal(number)
        code = self.process.wait(timeout_s)
        return code, time.monotonic() - started


@pytest.fixture
def start(domain, tmp_path):
    """Start ``python ARGUMENTS`` and have it ended with the test."""
    running = []

    def make(*arguments):
        running.append(Running([str(a) for a in arguments], tmp_path / f"process{len(running)}.log"))
        return running[-1]

    yield make
    for r in running:
        if r.process.poll() is None:
            r.process.kill()
            r.process.wait(LIMIT_S)


@pytest.fixture
def peer(domain):
    """A node of the test's own."""
    with Peer() as made:
        yield made
