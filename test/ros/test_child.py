"""What counts as hung: a process that could give a sign of life and does not."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from peer import LIMIT_S

from depth_pose.ros.process.child import PATIENCE_S, Child

SPIN = "print('it is ready', flush=True)\nwhile True: pass"


def run(program):
    return Child("it", [sys.executable, "-c", program], os.environ)


@pytest.fixture
def silent():
    """A process that was ready, never ends, and has given no sign of life for most of the patience."""
    child = run(SPIN)
    while child.ready_s > time.monotonic():
        child.read(lambda line: None)
    child.silent_s = PATIENCE_S - 0.5
    yield child
    child.kill()


def give_share(pid, cores, policy, group_nice):
    """Set where a process runs, and with which share of the processor."""
    os.sched_setaffinity(pid, cores)
    os.sched_setscheduler(pid, policy, os.sched_param(0))
    with contextlib.suppress(OSError):  # there are no groups by session
        Path(f"/proc/{pid}/autogroup").write_text(str(group_nice))


@pytest.fixture
def starved(silent):
    """The same on one core with a program that goes before it."""
    core = {min(os.sched_getaffinity(0))}
    give_share(silent.pid, core, os.SCHED_IDLE, 19)
    command = [sys.executable, "-c", SPIN]
    with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True) as first:
        os.sched_setaffinity(first.pid, core)
        first.stdout.readline()  # it runs
        yield silent, first
        first.kill()


STEP_S = 0.1


def check_repeatedly(child, told, seconds):
    """Check it for some seconds of the supervisor's own time, which no busy machine stretches."""
    for _ in range(round(seconds / STEP_S)):
        child.kill_if_hung(STEP_S, told.append)


def check_until(child, told, until):
    """Check it ten times a second until a condition holds."""
    limit_s = time.monotonic() + LIMIT_S
    while not until():
        assert time.monotonic() < limit_s, f"nothing in {LIMIT_S} s"
        time.sleep(STEP_S)
        child.kill_if_hung(STEP_S, told.append)


def await_state(pid, state):
    """Wait until Linux shows a process in a state: R runs, T is stopped."""
    limit_s = time.monotonic() + LIMIT_S
    while Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != state:
        assert time.monotonic() < limit_s, f"it is not in state {state}"
        time.sleep(0.01)


def test_who_waits_for_the_processor_does_not_hang(starved):
    child, first = starved
    told = []
    check_repeatedly(child, told, 2.0)
    assert not told and child.silent_s < PATIENCE_S
    first.kill()
    give_share(child.pid, os.sched_getaffinity(0), os.SCHED_OTHER, 0)
    check_until(child, told, lambda: told)  # it could now, and does not
    child.read(told.append)
    assert child.code == -signal.SIGKILL and len(told) == 1


def test_who_is_stopped_hangs_and_that_is_said_once(silent):
    os.kill(silent.pid, signal.SIGSTOP)
    await_state(silent.pid, "T")
    told = []
    check_repeatedly(silent, told, 1.5)
    assert told == ["[it] gave no sign of life for 3.0 s; it is killed"]
    silent.read(told.append)
    assert silent.code == -signal.SIGKILL


def test_who_has_done_its_work_may_be_killed():
    """Fast DDS does not always return from its goodbye: nothing is lost with the process then."""
    child = run("import time; print('it is ready\\nit has done its work', flush=True); time.sleep(60)")
    told, limit_s = [], time.monotonic() + LIMIT_S
    while child.ready_s > time.monotonic():
        assert time.monotonic() < limit_s
        child.read(told.append)
    child.kill()
    while child.code is None:  # on a busy machine the end takes a while
        assert time.monotonic() < limit_s
        child.read(told.append)
    assert child.code == 0
    assert told == ["[it] it is ready", "[it] had done its work, but did not end; it was killed"]


def test_who_is_told_to_end_while_it_loads_has_ended_cleanly():
    child, told = run("import time; time.sleep(60)"), []
    child.end()
    while child.code is None:
        child.read(told.append)
    assert child.code == 0 and not told


def test_what_it_prints_does_nothing_to_the_terminal_and_passes_for_no_sign():
    """Names of others may stand in its lines: they hold escapes, or what nodes say to their supervisor."""
    lines = [
        "\x1b]0;mine\x07 topic\r[up] all nodes are ready",
        "[WARN] of 'it has done its work'",
        "ready? that is ready",
    ]
    child = run(f"import time; print({chr(10).join(lines)!r}, flush=True); time.sleep(60)")
    told, limit_s = [], time.monotonic() + LIMIT_S
    while len(told) < len(lines):
        assert time.monotonic() < limit_s
        child.read(told.append)
    assert told[0] == "[it] \\x1b]0;mine\\x07 topic\\r[up] all nodes are ready"
    assert told[1:] == [f"[it] {line}" for line in lines[1:]]
    assert child.ready_s > time.monotonic()  # not yet
    child.kill()
    while child.code is None:
        child.read(told.append)
    assert child.code == -signal.SIGKILL  # its work was not done
