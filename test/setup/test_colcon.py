"""With colcon, as users of ROS from apt build it: in any workspace, and messages for other workspaces."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BOTH = {"depth_pose": "(ros.ament_python)", "depth_pose_msgs": "(ros.ament_cmake)"}

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("colcon_core") is None, reason="colcon is not in this Python"
)


def colcon(*arguments, cwd):
    environment = {**os.environ, "AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}
    environment |= {"VIRTUAL_ENV": sys.prefix, "PATH": f"{sys.prefix}/bin:{os.environ['PATH']}"}
    done = subprocess.run(
        [Path(sys.prefix) / "bin" / "colcon", *arguments],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.mark.parametrize("where", ["another workspace", "ros_ws", "the repository"])
def test_both_packages_are_found_in_any_workspace(where, tmp_path):
    """Cloned into somebody's ``src``, in the workspace that comes along, and from the root."""
    folder = {"ros_ws": ROOT / "ros_ws", "the repository": ROOT}.get(where, tmp_path)
    if folder == tmp_path:
        (tmp_path / "src").mkdir()
        (tmp_path / "src" / "cloned").symlink_to(ROOT)
    listed = colcon("--log-base", str(tmp_path / "log"), "list", cwd=folder)
    assert {line.split()[0]: line.split()[-1] for line in listed.stdout.splitlines()} == BOTH
    assert not listed.stderr


def test_the_package_installs_what_ros2_run_and_launch_look_for(tmp_path):
    colcon(
        *("--log-base", str(tmp_path / "log"), "build", "--base-paths", str(ROOT)),
        *("--packages-select", "depth_pose", "--packages-ignore", "depth_pose_msgs"),
        *("--build-base", str(tmp_path / "build"), "--install-base", str(tmp_path / "install")),
        cwd=tmp_path,
    )
    prefix = tmp_path / "install" / "depth_pose"
    assert {p.name for p in (prefix / "lib" / "depth_pose").iterdir()} == {
        "depth-pose",
        *("denoise_node", "matcher_node", "refine_node", "recovery_node", "volume_node", "fusion_node"),
    }
    assert (prefix / "share/ament_index/resource_index/packages/depth_pose").is_file()
    assert (prefix / "share/depth_pose/package.xml").is_file()
    assert (prefix / "share/depth_pose/launch/depth_pose.launch.py").is_file()
    package = next(prefix.glob("lib/python*/site-packages/depth_pose"))
    installed = files_of(package)
    assert installed == files_of(ROOT / "src" / "depth_pose")
    assert {".py", ".xml", ".yaml", ".npz", ".onnx"} <= {p.suffix for p in installed}


def files_of(package):
    """Return the files of a package, without the caches of Python and numba."""
    return {
        p.relative_to(package) for p in package.rglob("*.*") if p.parent.name != "__pycache__" and p.is_file()
    }


READER_XML = """<package format="3">
  <name>reader</name><version>0.0.0</version><description>reads skeletons</description>
  <maintainer email="a@b.example">a</maintainer><license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend><depend>depth_pose_msgs</depend>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""
READER_CPP = """
#include <depth_pose_msgs/msg/skeleton_array.hpp>
#include <cstdio>
int main() {
  depth_pose_msgs::msg::SkeletonArray people;
  people.skeletons.resize(2);
  people.skeletons[1].body_id = "body_7";
  people.skeletons[1].joints.resize(19);
  people.skeletons[1].joints[4].state = depth_pose_msgs::msg::Joint::SEEN;
  std::printf("%zu %s %zu\\n", people.skeletons.size(), people.skeletons[1].body_id.c_str(),
              people.skeletons[1].joints.size());
}
"""


def cmake_of_docs():
    """Return the lines for CMakeLists.txt from docs/topics.md."""
    return re.search(r"```cmake\n(.+?)```", (ROOT / "docs" / "topics.md").read_text(), re.DOTALL).group(1)


def test_a_node_in_c_plus_plus_of_another_workspace_gets_the_messages(tmp_path):
    """The lines of docs/topics.md, over an environment that holds the messages, as an underlay does."""
    package = tmp_path / "src" / "reader"
    (package / "src").mkdir(parents=True)
    (package / "package.xml").write_text(READER_XML)
    (package / "src" / "reader.cpp").write_text(READER_CPP)
    (package / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(reader)\nadd_executable(reader src/reader.cpp)\n"
        + cmake_of_docs()
        + "install(TARGETS reader DESTINATION lib/reader)\nament_package()\n"
    )
    includes = ROOT / "launch_scripts" / "helpers" / "drop_wheel_includes.cmake"
    colcon(
        *("--log-base", str(tmp_path / "log"), "build", "--cmake-args", "-G", "Ninja"),
        *(f"-DPython3_EXECUTABLE={sys.executable}", f"-DCMAKE_PROJECT_TOP_LEVEL_INCLUDES={includes}"),
        cwd=tmp_path,
    )
    done = subprocess.run(
        [tmp_path / "install" / "reader" / "lib" / "reader" / "reader"],
        env={**os.environ, "LD_LIBRARY_PATH": f"{sys.prefix}/lib"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (done.returncode, done.stdout) == (0, "2 body_7 19\n"), done.stderr
