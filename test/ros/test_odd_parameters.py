"""Every parameter of every node, set while it runs to what no setting can be: refused, and the node lives."""

import importlib
import math

import pytest
import rclpy
from rclpy.parameter import Parameter

from depth_pose.ros.process.supervisor import NODES

ODD = (math.nan, math.inf, -math.inf, 1e308, -1e308, 10**18, -(10**18), [math.nan], [1, 2], ["a"])
"""Not a number, huge, of a type that no setting has."""


@pytest.fixture
def make_node(domain, bank_path):
    """Make nodes as their processes do; all end with the test."""
    rclpy.init(args=[])
    made = []

    def make(name):
        module = importlib.import_module(f"depth_pose.ros.nodes.{name}_node")
        kind = getattr(module, f"{name.capitalize()}Node")
        kind.arguments = ["--ros-args", *(["-p", f"bank:={bank_path}"] if name != "denoise" else [])]
        try:
            made.append(kind())
        finally:
            kind.arguments = None
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()
    rclpy.try_shutdown()


def refused(node, name, value):
    """Set a parameter; gives the reason for which that is refused, or nothing."""
    (result,) = node.set_parameters([Parameter(name, value=value)])
    return "" if result.successful else result.reason or "without a reason"


@pytest.mark.parametrize("name", NODES)
def test_values_that_no_setting_can_have_are_refused(make_node, name):
    node = make_node(name)
    stage, names = node.stage, list(node.get_parameters_by_prefix(""))
    assert len(names) > 10
    for parameter in names:
        before = node.get_parameter(parameter).value
        for value in (*ODD, "x" if not isinstance(before, str) else True):
            reason = refused(node, parameter, value)
            assert reason and reason != "without a reason", (parameter, value)
        assert node.get_parameter(parameter).value == before
    assert node.stage is stage and node.is_active


def test_a_build_that_cannot_be_read_is_refused_by_the_running_node(make_node, tmp_path):
    node = make_node("refine")
    stage, odd = node.stage, tmp_path / "odd.json"
    odd.write_text('{"format": "depth_pose build", "version": 1, "scale": NaN, "parts": {}}')
    for value in ("/nowhere.json", str(odd), str(tmp_path), "/dev/zero", "a\0b"):
        assert refused(node, "build", value) not in ("", "without a reason"), value
    assert node.get_parameter("build").value == "" and node.stage is stage


@pytest.mark.parametrize(
    ("name", "parameter", "says"),
    [
        ("denoise", "segment.naer", "the parameter segment.naer; is segment.near meant?"),
        ("denoise", "segment.zone", "segment.zone is named zone"),
        ("recovery", "segment.near", "segment.near is a parameter of another node"),
        ("denoise", "x" * 20 + "\033[2J", "x\\x1b[2J; settings are named SECTION.NAME"),
    ],
)
def test_an_unknown_parameter_is_named_in_its_refusal(make_node, name, parameter, says):
    node = make_node(name)
    result = node.set_parameters_atomically([Parameter(parameter, value=1.0)])
    assert not result.successful and says in result.reason, result.reason
