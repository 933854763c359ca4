"""What lies in launch_scripts for ROS users agrees with the code."""

import ast
import importlib.util
import re
from pathlib import Path

import pytest
from yaml import safe_load

from depth_pose.core.config import PipelineConfig
from depth_pose.ros.nodes.parameters import EVERYWHERE
from depth_pose.ros.process import NODES

SCRIPTS = Path(__file__).parents[2] / "launch_scripts"


def test_example_parameters_are_valid():
    values = safe_load((SCRIPTS / "params.yaml").read_text())["/**"]["ros__parameters"]
    sections = {k: v for k, v in values.items() if isinstance(v, dict)}
    assert PipelineConfig.from_mapping(sections) == PipelineConfig()  # it shows the defaults
    assert set(values) - set(sections) <= EVERYWHERE


def test_launch_file_parses():
    """`launch` is not on the package index; what can be held without it is held."""
    tree = ast.parse((SCRIPTS / "depth_pose.launch.py").read_text())
    functions = {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}
    assert "generate_launch_description" in functions


def test_launch_file_starts_modules_that_exist():
    (pattern,) = re.findall(r'f"(depth_pose\.[^"]+)"', (SCRIPTS / "depth_pose.launch.py").read_text())
    for name in NODES:
        assert importlib.util.find_spec(pattern.format(name=name)) is not None


def test_launch_file_runs_where_launch_is_there():
    """With `launch_ros` the description is made for real: four nodes with the sensor's parameters."""
    pytest.importorskip("launch_ros", reason="launch comes with ROS 2 from apt")
    from launch import LaunchContext

    spec = importlib.util.spec_from_file_location("depth_pose_launch", SCRIPTS / "depth_pose.launch.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    context = LaunchContext()
    values = {name: default for name, (default, _) in module.ARGUMENTS.items()}
    context.launch_configurations.update(values | {"sensor": "realsense"})
    assert len(module.make_nodes(context)) == 4
    assert module.generate_launch_description().entities


def test_launch_file_sets_parameters_that_the_nodes_have():
    tree = ast.parse((SCRIPTS / "depth_pose.launch.py").read_text())
    (arguments,) = (
        n.value
        for n in tree.body
        if isinstance(n, ast.Assign) and getattr(n.targets[0], "id", "") == "ARGUMENTS"
    )
    names = {ast.literal_eval(key) for key in arguments.keys}
    assert names - {"sensor", "params_file", "namespace"} <= EVERYWHERE
