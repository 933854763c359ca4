"""With colcon, as users of ROS from apt build it: README's line finds and installs both packages."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("colcon_core") is None, reason="colcon is not in this Python"
)


def colcon(*arguments, cwd):
    environment = {**os.environ, "AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}
    done = subprocess.run(
        [Path(sys.prefix) / "bin" / "colcon", *arguments],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("arguments", [(), ("--base-paths", "src", "..")], ids=["defaults", "readme"])
def test_both_packages_are_found(arguments, tmp_path):
    listed = colcon("--log-base", str(tmp_path), "list", *arguments, cwd=ROOT / "ros_ws")
    kinds = {line.split()[0]: line.split()[-1] for line in listed.splitlines()}
    assert kinds == {"depth_pose": "(ros.ament_python)", "depth_pose_msgs": "(ros.ament_cmake)"}


def test_readme_has_the_line():
    assert "colcon build --base-paths src .." in (ROOT / "README.md").read_text()


def test_the_package_installs_what_ros2_run_and_launch_look_for(tmp_path):
    colcon(
        *("--log-base", str(tmp_path / "log"), "build", "--base-paths", str(ROOT)),
        *("--packages-select", "depth_pose", "--packages-ignore", "depth_pose_msgs"),
        *("--build-base", str(tmp_path / "build"), "--install-base", str(tmp_path / "install")),
        cwd=tmp_path,
    )
    prefix = tmp_path / "install" / "depth_pose"
    assert {p.name for p in (prefix / "lib" / "depth_pose").iterdir()} == {
        *("depth-pose", "denoise_node", "matcher_node", "refine_node", "recovery_node", "volume_node")
    }
    assert (prefix / "share/ament_index/resource_index/packages/depth_pose").is_file()
    assert (prefix / "share/depth_pose/package.xml").is_file()
    assert (prefix / "share/depth_pose/launch/depth_pose.launch.py").is_file()
    package = next(prefix.glob("lib/python*/site-packages/depth_pose"))
    installed = {p.relative_to(package) for p in package.rglob("*") if p.suffix in (".py", ".xml", ".yaml")}
    source = ROOT / "src" / "depth_pose"
    assert installed == {
        p.relative_to(source) for p in source.rglob("*") if p.suffix in (".py", ".xml", ".yaml")
    }
