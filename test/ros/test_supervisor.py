"""The supervisor with real nodes: readiness, restarts, clean ends, and its own death."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from peer import LIMIT_S, within

from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import ConfigError
from depth_pose.ros.process import NODES, child, supervisor
from depth_pose.ros.process.supervisor import Suite, sensor_names


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def children(pid):
    """Processes that one has started, by any of its threads."""
    return [int(c) for f in Path(f"/proc/{pid}/task").glob("*/children") for c in f.read_text().split()]


def title(pid):
    return Path(f"/proc/{pid}/comm").read_text().strip()


def wait_until(condition, what):
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline, f"{what} took longer than {LIMIT_S} s"
        time.sleep(0.02)


def test_a_node_that_did_not_run_joins_the_graph_again(domain, peer, monkeypatch):
    """Others may have dropped it, and not all of Fast DDS comes back by itself: another takes its place."""
    monkeypatch.setattr(child, "PATIENCE_S", 3600.0)
    lines = []
    with Suite(nodes=["denoise"], sink=lines.append) as suite:
        first = suite.pid("denoise")
        os.kill(first, signal.SIGSTOP)
        time.sleep(5.0)
        os.kill(first, signal.SIGCONT)
        wait_until(lambda: suite.restarts["denoise"] == 1, "its end")
        suite.wait_ready()
        assert suite.pid("denoise") != first and not alive(first)
    assert any("[denoise] did not run for 4.5 s or more" in line for line in lines), lines


def test_only_a_node_that_dies_young_again_and_again_waits(domain, peer, monkeypatch):
    """One that was ready for a while is replaced at once, however often; that also ends an earlier wait."""
    lines, pids = [], []
    with Suite(nodes=["denoise"], sink=lines.append) as suite:
        assert any(line.startswith("[denoise] ") and "is ready" in line for line in lines)
        for count, young in enumerate((False, False, True, True, False), start=1):
            with monkeypatch.context() as patch:
                if young:  # however long the machine stood still since it was ready
                    patch.setattr(supervisor, "HEALTHY_S", 3600.0)
                else:  # sooner than usual, which saves three waits of three seconds
                    patch.setattr(supervisor, "HEALTHY_S", 0.2)
                    wait_until(lambda: suite.lived_s("denoise") > 0.3, "that it lives so long")
                pids.append(suite.pid("denoise"))
                os.kill(pids[-1], signal.SIGKILL)
                wait_until(lambda n=count: suite.restarts["denoise"] == n, "the restart")
            suite.wait_ready()
        peer.until(lambda: peer.node.count_publishers("/depth_pose/points"), what="the new node's topic")
        assert suite.stop() == {"denoise": 0}
    assert len(set(pids)) == len(pids) and not any(map(alive, pids))
    ends = [line.partition("with ")[2] for line in lines if "starting it again" in line]
    waits = ["at once", "at once", "in 0.1 s", "in 0.2 s", "at once"]
    assert ends == [f"code -9; starting it again {wait}" for wait in waits]


def test_it_ends_at_once_while_it_loads(domain):
    def attempt():
        suite = Suite(nodes=["denoise"], sink=str)
        suite.start()
        wait_until(lambda: suite.pid("denoise"), "the node's process")
        pid, started = suite.pid("denoise"), time.monotonic()
        codes = suite.stop()
        took = time.monotonic() - started
        assert not alive(pid) and codes == {"denoise": 0}
        return took

    within(1.0, attempt)


def test_what_cannot_start_is_said(domain, tmp_path):
    params = tmp_path / "params.yaml"
    params.write_text("/**:\n  ros__parameters:\n    segment:\n      naer: 0.5\n")
    says = r"the parameter segment\.naer; is segment\.near meant"
    with pytest.raises(ConfigError, match=says), Suite(params, nodes=["denoise"], sink=str):
        pass
    params.write_text("/**:\n  ros__parameters:\n    follow:\n      whom: nearest\n")
    says = r"follow\.whom is named follow"
    with pytest.raises(ConfigError, match=says), Suite(params, nodes=["recovery"], sink=str):
        pass
    with pytest.raises(ConfigError, match="realsense"):
        Suite(sensor="webcam")
    with pytest.raises(ConfigError, match="no parameter file"):
        Suite(tmp_path / "none.yaml")


@pytest.mark.parametrize("sensor", sensor_names())
def test_sensor_files_hold_topics(sensor):
    from yaml import safe_load

    from depth_pose.ros.process.supervisor import SENSORS_PATH

    values = safe_load((SENSORS_PATH / f"{sensor}.yaml").read_text())["/**"]["ros__parameters"]
    topics = {"image_topic", "info_topic"}
    assert topics <= set(values) <= topics | {"segment"}
    near_and_far = values.get("segment", {})
    assert PipelineConfig.from_mapping({"segment": near_and_far}) != PipelineConfig() or not near_and_far


def test_files_and_single_parameters_reach_the_node(domain, tmp_path):
    params = tmp_path / "params.yaml"
    params.write_text("/**:\n  ros__parameters:\n    segment:\n      near: 1\n    image_topic: /elsewhere\n")
    lines = []
    with Suite(params, "kinect2", parameters={"segment.far": 5.0}, nodes=["denoise"], sink=lines.append):
        assert any("listens to /elsewhere" in line for line in lines)


def test_nodes_end_when_the_supervisor_is_killed(domain):
    code = (
        "import time; from depth_pose.ros.process.supervisor import Suite\n"
        "suite = Suite(nodes=['denoise'], sink=lambda line: None)\n"
        "suite.start(); suite.wait_ready(); print(suite.pid('denoise'), flush=True); time.sleep(600)"
    )

    def attempt():
        supervisor = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        try:
            pid = int(supervisor.stdout.readline())
            assert alive(pid)
        finally:
            supervisor.kill()
            supervisor.wait(LIMIT_S)
        killed = time.monotonic()
        wait_until(lambda: not alive(pid), "the end of the node")
        return time.monotonic() - killed

    within(2.0, attempt)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_up_ends_cleanly(start, bank_path, number):
    """On Ctrl-C, and when its terminal is closed; until then `ps` shows each node by its name."""
    code = (
        f"import signal, sys; signal.signal({int(number)}, signal.SIG_DFL)\n"  # nohup has SIGHUP ignored
        "from depth_pose.ros.process import supervisor\n"
        f"supervisor._STOP_PATIENCE_S = {LIMIT_S}\n"
        f"sys.exit(supervisor.up(bank={str(bank_path)!r}))"
    )
    process = start("-c", code)
    process.wait_for("all nodes are ready", 300.0)
    assert sorted(map(title, children(process.process.pid))) == sorted(f"{name}_node" for name in NODES)
    code, _ = process.end(number)
    assert code == 0, process.output  # a node that had to be killed would make it 1
    assert "Traceback" not in process.output
