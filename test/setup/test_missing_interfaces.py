"""Interfaces are built only where ROS does not bring them."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
WHEEL_ONLY = ROOT / "ros_ws" / "wheel_only"
NAMES = ["hri_msgs", "tf2_msgs"]


def missing(environment):
    script = f"source {ROOT}/launch_scripts/helpers/missing_interfaces.sh; missing_interfaces $0 $1"
    done = subprocess.run(
        ["bash", "-euc", script, environment, WHEEL_ONLY], capture_output=True, text=True, check=True
    )
    return done.stdout.split()


def install(environment, name, package_xml):
    folder = environment / "share" / name
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text(package_xml)


def test_all_are_built_into_a_new_environment_and_again_into_it(tmp_path):
    assert missing(tmp_path) == NAMES
    for name in NAMES:
        install(tmp_path, name, (WHEEL_ONLY / name / "package.xml").read_text())
    assert missing(tmp_path) == NAMES  # ours: a changed definition is built again


def test_what_ros_brings_is_left_alone(tmp_path):
    install(tmp_path, "tf2_msgs", "<package><name>tf2_msgs</name><version>0.36.12</version></package>")
    assert missing(tmp_path) == ["hri_msgs"]


def test_colcon_does_not_find_them_by_itself(tmp_path):
    command = [Path(sys.prefix) / "bin" / "colcon", "--log-base", tmp_path, "list", "--names-only"]
    done = subprocess.run(
        [*command, "--base-paths", ROOT / "ros_ws"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "depth_pose_msgs" in done.stdout.split()
    assert not set(NAMES) & set(done.stdout.split())
