"""Parts of a task in processes and on a cluster."""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import distributed
import numpy as np
import pytest
from task_parts import die_once, first_then_sleep, square

from depth_pose.bank import build as building
from depth_pose.bank import build_bank
from depth_pose.bank.build import BuildConfig
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.workers import run_each, run_parts
from depth_pose.motion.procedural.generator import make_clip


def test_what_fails_does_not_stop_the_rest():
    told = set()
    tasks = [(number,) for number in range(7)]
    outcomes = list(run_each(square, tasks, 2, listen=lambda index, share: told.add((index, share))))
    assert sorted(o.index for o in outcomes) == list(range(7))
    values = {o.index: o.value for o in outcomes if o.error is None}
    assert values == {0: 0, 1: 1, 5: 25, 6: 36}
    errors = {o.index: o.error for o in outcomes if o.error is not None}
    assert isinstance(errors[2], InputError)
    assert "died 2 times, the last time by signal 9" in str(errors[2])
    assert repr(errors[3]) == "ValueError('three')"
    assert "cannot be sent" in str(errors[4])
    assert told == {(index, 0.5) for index in range(7)}


def test_a_task_whose_process_dies_is_begun_again(tmp_path):
    tasks = [(tmp_path / "mark", number) for number in range(4)]
    outcomes = list(run_each(die_once, tasks, 2))
    assert sorted(o.index for o in outcomes) == list(range(4))
    assert all(o.error is None for o in outcomes)


def test_the_first_error_of_parts_is_raised():
    with pytest.raises(ZeroDivisionError):
        list(run_parts(divmod, [(4, 2), (1, 0), (9, 3)], workers=0))
    with pytest.raises(ZeroDivisionError):
        list(run_parts(divmod, [(4, 2), (1, 0), (9, 3)], workers=1))


LIMIT_S = 120.0
"""Hard limit of every wait: it tells that something is wrong, not how fast it is."""


def wait_until(condition, what):
    limit_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < limit_s, f"{what} took longer than {LIMIT_S} s"
        time.sleep(0.02)


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_workers_end_with_whoever_started_them(tmp_path):
    """A process that is killed leaves none of its own behind, in the middle of a task."""
    mark = tmp_path / "mark"
    code = f"""if __name__ == "__main__":
    import sys; sys.path[:] = {sys.path!r}
    from pathlib import Path
    from task_parts import sleep
    from depth_pose.core.workers import run_each, run_parts
    list(run_parts(sleep, [(Path({str(mark)!r}),)], 1))"""
    (tmp_path / "program.py").write_text(code)
    program = subprocess.Popen([sys.executable, tmp_path / "program.py"])
    wait_until(mark.exists, "the worker's start")
    worker = int(mark.read_text())
    assert is_running(worker)
    program.kill()
    program.wait()
    wait_until(lambda: not is_running(worker), "the worker's end")


def test_who_stops_listening_ends_the_workers(tmp_path):
    marks = [tmp_path / str(k) for k in range(2)]
    outcomes = run_each(first_then_sleep, [(mark,) for mark in marks], 2)
    next(outcomes)
    wait_until(lambda: all(mark.exists() for mark in marks), "the workers' start")
    outcomes.close()
    assert not any(is_running(int(mark.read_text())) for mark in marks)


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as made:
        yield made.scheduler_address


@pytest.mark.parametrize("views", ["partial", "paper"])
def test_cluster_builds_the_same_bank(body, cluster, views, monkeypatch):
    monkeypatch.setattr(building, "POSES_PER_PART", 2)  # three parts for two workers
    poses = make_clip("wave", fps=4.0, seconds=4.0, seed=2).rotations[::3]
    config = BuildConfig(dimensions=12, views=views)
    told = []
    here = build_bank(body, poses, config, {}, workers=0)
    there = build_bank(body, poses, config, {}, lambda done, _: told.append(done), scheduler=cluster)
    assert there.bank_id == here.bank_id
    assert told[-1] == len(poses)


def test_results_come_in_order(cluster):
    tasks = [(np.arange(n),) for n in range(12)]
    assert list(run_parts(len, tasks, scheduler=cluster)) == list(range(12))


@pytest.mark.slow
def test_a_scheduler_that_dies_is_said_in_one_line(tmp_path):
    start = """if __name__ == "__main__":
    import distributed, time
    made = distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None, protocol="tcp")
    print(made.scheduler_address, flush=True)
    time.sleep(600)"""
    (tmp_path / "cluster.py").write_text(start)
    mark = tmp_path / "mark"
    code = f"""if __name__ == "__main__":
    import sys; sys.path[:] = {sys.path!r}
    from pathlib import Path
    from task_parts import first_then_sleep
    from depth_pose.core.workers import run_each
    from depth_pose.core.errors import InputError
    try:
        list(run_each(first_then_sleep, [(Path({str(mark)!r}),)], scheduler=sys.argv[1]))
    except InputError as error:
        sys.exit(f"error: {{error}}")"""
    (tmp_path / "program.py").write_text(code)
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    cluster = subprocess.Popen(
        [sys.executable, tmp_path / "cluster.py"], stdout=subprocess.PIPE, text=True, env=paths
    )
    address = cluster.stdout.readline().strip()
    program = subprocess.Popen(
        [sys.executable, tmp_path / "program.py", address], stderr=subprocess.PIPE, text=True
    )
    try:
        wait_until(lambda: mark.exists() or program.poll() is not None, "the task's start")
        cluster.kill()
        _, said = program.communicate(timeout=LIMIT_S)
    finally:
        program.kill()
        cluster.kill()
    assert program.returncode == 1
    assert said.strip() == f"error: the Dask scheduler at {address} is gone"


def test_no_scheduler_there(monkeypatch):
    monkeypatch.setattr("depth_pose.core.workers.CONNECT_S", "1s")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(InputError, match="no Dask scheduler answers at tcp"):
        list(run_parts(len, [((),)], scheduler=address))


def test_dask_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match=r"depth_pose\[dask\]"):
        list(run_parts(len, [((),)], scheduler="tcp://127.0.0.1:1"))
