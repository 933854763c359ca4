"""The pulse of a node's process: signs of life, and its end where nobody hears them or it has starved."""

import os
import signal
import subprocess
import sys

import pytest
from peer import LIMIT_S

from depth_pose.ros.process import BEAT
from depth_pose.ros.process.pulse import STARVED_S

PROGRAM = """
import signal
from depth_pose.ros.process import pulse
pulse.STARVED_S = {starved_s}
pulse.start_pulse({beats})
print("runs", flush=True)
signal.pause()
"""


@pytest.fixture
def start():
    """Start a program with a pulse; killed at the end of the test."""
    started = []

    def make(beats, starved_s=STARVED_S):
        code = PROGRAM.format(beats=beats, starved_s=starved_s)
        started.append(subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE))
        return started[-1]

    yield make
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


def read_until(process, wanted):
    """Read what it prints until something has come."""
    seen = b""
    while wanted not in seen:
        came = os.read(process.stdout.fileno(), 1 << 16)
        assert came, f"it ended after {seen!r}"
        seen += came
    return seen


def test_it_beats_until_nobody_hears_it(start):
    process = start(beats=True)
    read_until(process, b"runs")
    for _ in range(3):
        read_until(process, BEAT)
    process.stdout.close()
    assert process.wait(LIMIT_S) == -signal.SIGTERM


def test_who_did_not_run_for_long_says_so_and_ends(start):
    process = start(beats=False, starved_s=0.5)
    read_until(process, b"runs")
    process.send_signal(signal.SIGSTOP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(1.0)
    process.send_signal(signal.SIGCONT)
    read_until(process, b"did not run for 0.5 s or more")
    assert process.wait(LIMIT_S) == -signal.SIGTERM
    assert BEAT not in process.stdout.read()  # nobody has asked for signs of life
