"""SROS2 that is asked for: what does not start, or starts without it, is one line with the cure.

ROS 2 from the package index has no SROS2, so what happens with keys that are right is not tested here.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from peer import LIMIT_S

TRIAL = Path(__file__).with_name("trial_node.py")
PROGRAMS = {
    "node": (TRIAL,),
    "topics": ("-m", "depth_pose.cli", "topics"),
    "record": ("-m", "depth_pose.cli", "record", "-o", "out.mcap", "--seconds", "0.1"),
    "up": ("-m", "depth_pose.cli", "up"),
}
"""The node, and commands that start ROS themselves: in a thread, or before they start nodes."""


@pytest.fixture
def ask(monkeypatch, tmp_path):
    """Ask for security by the environment."""

    def set_environment(keystore: str, strategy: str = "Enforce", enclave: str = "", enable: str = "true"):
        (tmp_path / "empty").mkdir()
        (tmp_path / "keys" / "enclaves").mkdir(parents=True)
        monkeypatch.setenv("ROS_SECURITY_ENABLE", enable)
        monkeypatch.setenv("ROS_SECURITY_STRATEGY", strategy)
        monkeypatch.setenv("ROS_SECURITY_KEYSTORE", keystore and str(tmp_path / keystore))
        monkeypatch.setenv("ROS_SECURITY_ENCLAVE_OVERRIDE", enclave)
        monkeypatch.setenv("COLUMNS", "300")
        monkeypatch.chdir(tmp_path)

    return set_environment


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(
    ("keystore", "enclave", "said"),
    [
        ("", "", "(ROS_SECURITY_KEYSTORE is not set): set ROS_SECURITY_KEYSTORE to a keystore of"),
        ("empty", "", "(ROS_SECURITY_KEYSTORE is no keystore: "),
        ("keys", "/camera", "keys has no enclave /camera): make it with `ros2 security create_enclave"),
        ("keys", "", "(This Fast DDS version doesn't have the security libraries): check the keys"),
    ],
)
def test_what_does_not_start_is_one_line(start, ask, tmp_path, program, keystore, enclave, said):
    ask(keystore, enclave=enclave)
    process = start(*PROGRAMS[program])
    assert process.process.wait(LIMIT_S) == 2
    process.wait_for("asks for SROS2")
    (line,) = [line for line in process.output.splitlines() if "SROS2" in line]
    assert said in line
    assert "Traceback" not in process.output and "Warning" not in process.output
    assert "recording" not in process.output and not list(tmp_path.glob("*.mcap"))


@pytest.mark.parametrize(
    ("strategy", "enable", "said"),
    [
        (
            "Permissive",
            "true",
            "ROS_SECURITY_KEYSTORE is not set; with ROS_SECURITY_STRATEGY=Enforce it would not",
        ),
        ("Enforce", "1", "ROS_SECURITY_ENABLE is '1', and only 'true' asks for SROS2"),
        ("", "false", ""),
        ("", "0", ""),
    ],
)
def test_a_start_without_the_security_asked_for_is_said(start, ask, strategy, enable, said):
    ask("", strategy, enable=enable)
    process = start(TRIAL)
    process.wait_for("is ready")
    assert process.output.count("without security") == bool(said) and said in process.output


def test_nodes_of_one_start_say_it_once(start, ask):
    ask("", "")
    process = start("-m", "depth_pose.cli", "up")
    process.wait_for("all nodes are ready")
    assert process.output.count("without security") == 1
