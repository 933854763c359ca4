"""What lies in launch_scripts for ROS users agrees with the code."""

import ast
from pathlib import Path

from yaml import safe_load

from depth_pose.config import PipelineConfig
from depth_pose.ros.parameters import EVERYWHERE

SCRIPTS = Path(__file__).parents[2] / "launch_scripts"


def test_example_parameters_are_valid():
    values = safe_load((SCRIPTS / "params.yaml").read_text())["/**"]["ros__parameters"]
    sections = {k: v for k, v in values.items() if isinstance(v, dict)}
    PipelineConfig.from_mapping(sections)
    assert set(values) - set(sections) <= EVERYWHERE


def test_launch_file_parses():
    """`launch` is not on the package index; what can be held without it is held."""
    tree = ast.parse((SCRIPTS / "depth_pose.launch.py").read_text())
    functions = {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}
    assert "generate_launch_description" in functions
