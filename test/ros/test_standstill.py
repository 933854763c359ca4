"""Fast DDS that stands still in a process: it is noticed, and the process makes way for another."""

from __future__ import annotations

import ctypes
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from peer import LIMIT_S

from depth_pose.ros.process.standstill import StandstillWatch

PR_SET_NAME = 15

LOCKED_OUT = """
import ctypes, threading
from depth_pose.ros.process.host import _watch_supervisor

def wait():
    ctypes.CDLL(None).prctl(15, b"dds.ev.0")
    threading.Event().wait()

threading.Thread(target=wait, daemon=True).start()
_watch_supervisor(8)
"""


@pytest.fixture
def timers():
    """A thread that is named as those of Fast DDS, and wakes up every so often, or never."""
    ended = threading.Event()

    def make(every_s: float | None) -> None:
        def run() -> None:
            ctypes.CDLL(None).prctl(PR_SET_NAME, b"dds.ev.0")
            while not ended.wait(every_s):
                pass

        threading.Thread(target=run, daemon=True).start()

    yield make
    ended.set()


def test_a_thread_that_never_runs_is_noticed_after_so_many_looks(timers) -> None:
    timers(None)
    time.sleep(0.2)
    watch = StandstillWatch(4)
    assert [watch.look() for _ in range(6)] == [False] * 4 + [True] * 2


def test_one_that_runs_now_and_then_is_not(timers) -> None:
    timers(0.1)
    watch = StandstillWatch(3)
    for _ in range(12):
        assert not watch.look()
        time.sleep(0.15)


def test_without_fast_dds_nothing_stands_still() -> None:
    looks = "print(*[watch.look() for _ in range(4)])"
    code = (
        f"from depth_pose.ros.process.standstill import StandstillWatch; watch = StandstillWatch(1); {looks}"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT_S)
    assert told.stdout.split() == ["False"] * 4, told.stderr


@pytest.mark.slow
def test_fast_dds_itself_runs(peer) -> None:
    watch = StandstillWatch(8)
    for _ in range(16):
        peer.spin(0.25)
        assert not watch.look()
    assert watch._seen


@pytest.mark.slow
def test_a_process_in_which_it_stands_still_ends_and_says_why() -> None:
    ours, theirs = socket.socketpair()
    began = time.monotonic()
    with ours, theirs:
        process = subprocess.Popen([sys.executable, "-c", LOCKED_OUT], stdin=theirs, stdout=theirs)
        assert process.wait(LIMIT_S) == -signal.SIGKILL
        told = ours.recv(1 << 16).decode()
    assert "Fast DDS has stood still for 7 s" in told
    assert time.monotonic() - began > 6.5
