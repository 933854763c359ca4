import socket
import sys

import distributed
import numpy as np
import pytest

from depth_pose.bank import build as building
from depth_pose.bank import build_bank
from depth_pose.bank.build import BuildConfig
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.workers import run_parts
from depth_pose.motion.procedural.generator import make_clip


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as made:
        yield made.scheduler_address


@pytest.mark.parametrize("views", ["partial", "paper"])
def test_cluster_builds_the_same_bank(body, cluster, views, monkeypatch):
    monkeypatch.setattr(building, "_CHUNK", 4)
    poses = make_clip("wave", fps=4.0, seconds=4.0, seed=2).rotations
    config = BuildConfig(dimensions=12, views=views)
    told = []
    here = build_bank(body, poses, config, {}, workers=0)
    there = build_bank(body, poses, config, {}, lambda done, _: told.append(done), scheduler=cluster)
    assert there.bank_id == here.bank_id
    assert told[-1] == len(poses)


def test_results_come_in_order(cluster):
    tasks = [(np.arange(n),) for n in range(12)]
    assert list(run_parts(len, tasks, scheduler=cluster)) == list(range(12))


def test_no_scheduler_there(monkeypatch):
    monkeypatch.setattr("depth_pose.core.workers._CONNECT_S", "1s")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(InputError, match="no Dask scheduler answers at tcp"):
        list(run_parts(len, [((),)], scheduler=address))


def test_dask_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match=r"depth_pose\[dask\]"):
        list(run_parts(len, [((),)], scheduler="tcp://127.0.0.1:1"))
