"""What lies in launch_scripts for ROS users agrees with the code."""

import ast
import importlib.util
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from peer import LIMIT_S
from yaml import safe_load

from depth_pose.core.config import PipelineConfig
from depth_pose.core.settings_file import read_settings
from depth_pose.ros.nodes.parameters import EVERYWHERE, parameter_name
from depth_pose.ros.process import NODES

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "launch_scripts"
DEFAULTS = PipelineConfig().as_mapping()


def test_example_parameters_are_valid():
    """For nodes, which know each setting by one name, and for `depth-pose run --params`."""
    values = safe_load((SCRIPTS / "params.yaml").read_text())["/**"]["ros__parameters"]
    sections = {k: v for k, v in values.items() if isinstance(v, dict)}
    names = {f"{section}.{key}" for section, part in sections.items() for key in part}
    known = {parameter_name(section, key) for section, part in DEFAULTS.items() for key in part}
    assert names | (set(values) - set(sections)) <= EVERYWHERE | known
    settings = read_settings(SCRIPTS / "params.yaml")
    assert PipelineConfig.from_mapping(settings) == PipelineConfig()  # it shows the defaults


def test_launch_file_parses():
    """`launch` is not on the package index; what can be held without it is held."""
    tree = ast.parse((SCRIPTS / "depth_pose.launch.py").read_text())
    functions = {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}
    assert "generate_launch_description" in functions


def test_launch_file_starts_programs_that_exist():
    """By package and name, so that each runs in the interpreter that colcon wrote into it."""
    text = (SCRIPTS / "depth_pose.launch.py").read_text()
    assert 'package="depth_pose"' in text and 'executable=f"{name}_node"' in text
    setup = (ROOT / "ros_ws" / "src" / "depth_pose" / "setup.py").read_text()
    programs = ast.literal_eval(re.search(r"^NODES = (\(.+\))$", setup, re.MULTILINE).group(1))
    assert set(NODES) <= set(programs)
    assert all(importlib.util.find_spec(f"depth_pose.ros.nodes.{name}_node") for name in programs)


def launch(*arguments, tmp_path):
    """Start ``ros2 launch`` with the installed package; gives the process and its log."""
    log = tmp_path / "launch.log"
    with log.open("wb") as stream:
        command = [Path(sys.prefix) / "bin" / "ros2", "launch", "depth_pose", "depth_pose.launch.py"]
        return subprocess.Popen([*command, *arguments], stdout=stream, stderr=subprocess.STDOUT), log


@pytest.fixture
def installed():
    """Skip where ``ros2 launch`` is not, or the package has not been built with colcon."""
    pytest.importorskip("ros2launch", reason="launch comes with ROS 2 from apt")
    packages = pytest.importorskip("ament_index_python.packages")
    try:
        prefix = Path(packages.get_package_prefix("depth_pose"))
    except packages.PackageNotFoundError:
        pytest.skip("depth_pose has not been built with colcon in this environment")
    return prefix


@pytest.mark.parametrize(
    ("argument", "said"),
    [("sensor:=webcam", "realsense"), ("params_file:=/none.yaml", "there is no parameter file /none.yaml")],
)
def test_what_is_wrong_is_refused_by_launch(installed, tmp_path, argument, said):
    process, log = launch(argument, tmp_path=tmp_path)
    assert process.wait(LIMIT_S) == 1
    assert said in log.read_text()


def test_a_refused_setting_ends_the_launch(installed, domain, tmp_path):
    params = tmp_path / "params.yaml"
    params.write_text("/**:\n  ros__parameters:\n    segment:\n      naer: 0.5\n")
    process, log = launch(f"params_file:={params}", tmp_path=tmp_path)
    process.wait(2 * LIMIT_S)
    assert "segment.naer" in log.read_text()
    assert log.read_text().count("process started") == len(NODES)  # none a second time


def test_sigterm_to_launch_leaves_no_orphan(installed, domain, tmp_path):
    process, log = launch("namespace:=left", tmp_path=tmp_path)
    deadline = time.monotonic() + 2 * LIMIT_S
    while log.read_text().count("is ready") < len(NODES):
        assert process.poll() is None and time.monotonic() < deadline, log.read_text()
        time.sleep(0.2)
    text = log.read_text()
    found = dict(re.findall(r"\[(\w+)_node-\d\]: process started with pid \[(\d+)\]", text))
    assert set(found) == set(NODES)  # the log tells them apart
    program = installed / "lib" / "depth_pose" / "refine_node"
    shebang = program.read_text().splitlines()[0].removeprefix("#!")
    started = Path(f"/proc/{found['refine']}/cmdline").read_bytes().split(b"\0")[0].decode()
    assert started == shebang  # the environment's interpreter, not that of ros2
    process.terminate()
    process.wait(LIMIT_S)
    deadline = time.monotonic() + LIMIT_S
    while any(Path(f"/proc/{pid}").exists() for pid in found.values()):
        assert time.monotonic() < deadline, "orphans"
        time.sleep(0.05)


def test_launch_file_sets_parameters_that_the_nodes_have():
    tree = ast.parse((SCRIPTS / "depth_pose.launch.py").read_text())
    (arguments,) = (
        n.value
        for n in tree.body
        if isinstance(n, ast.Assign) and getattr(n.targets[0], "id", "") == "ARGUMENTS"
    )
    names = {ast.literal_eval(key) for key in arguments.keys}
    assert names - {"sensor", "params_file", "namespace"} <= EVERYWHERE
