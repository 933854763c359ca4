"""One list of dependencies, pyproject.toml's, serves pip, apt and rosdep."""

import ast
import re
import subprocess
import sys
from importlib.metadata import requires
from pathlib import Path
from xml.etree import ElementTree

from depth_pose.core.extras import EXTRAS

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "ros_ws" / "src" / "depth_pose"
MESSAGES = ROOT / "ros_ws" / "src" / "depth_pose_msgs"

NOBLE = {
    "matplotlib": ("python3-matplotlib", "3.6.3"),
    "numpy": ("python3-numpy", "1.26.4"),
    "pyyaml": ("python3-yaml", "6.0.1"),
    "rich": ("python3-rich", "13.7.1"),
    "scipy": ("python3-scipy", "1.11.4"),
}
"""Libraries of Ubuntu 24.04 that are new enough: their rosdep keys and versions there.

Its typer is 0.9, which does not know ``str | None``, its numba 0.58, its pillow 10.2: these come with pip.
"""


def requirements(*names):
    """Return the output of the set-up's script: name and specifier of every dependency, or of extras."""
    done = subprocess.run(
        [sys.executable, ROOT / "launch_scripts/helpers/requirements.py", *(names or ["dependencies"])],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [re.match(r"([\w-]+)\s*([^;\s]*)", line) for line in done.stdout.splitlines()]
    return {m.group(1): m.group(2) for m in lines}


def depends(folder):
    root = ElementTree.parse(folder / "package.xml").getroot()
    return {e.text for e in root if e.tag in ("depend", "exec_depend", "buildtool_depend")}


BROUGHT = {"lz4": "mcap", "zstandard": "mcap"}
"""What is imported and comes with another that is in the list: that one, by the names of packages."""

PACKAGES = {
    "PIL": "pillow",
    "yaml": "pyyaml",
    "libusb_package": "libusb-package",
    "pythonosc": "python-osc",
}
"""Names of packages that are not those of their modules."""

ROS = r"rclpy|\w+_(?:msgs|interfaces)"


def imported():
    """Return the packages outside the standard library that the sources import, by their import names."""
    names = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.partition(".")[0])
    return names - set(sys.stdlib_module_names) - {"depth_pose"}


def test_what_apt_serves_is_new_enough_and_declared():
    wanted = requirements("dependencies", "pictures")
    for name, (key, version) in NOBLE.items():
        least = re.search(r">=([\d.]+)", wanted[name]).group(1)
        assert [int(n) for n in version.split(".")] >= [int(n) for n in least.split(".")], name
        assert key in depends(ROOT) & depends(PACKAGE), name


def test_manifests_name_nothing_else():
    for folder in (ROOT, PACKAGE):
        assert {d for d in depends(folder) if d.startswith("python3-")} == {k for k, _ in NOBLE.values()}
    both = (depends(PACKAGE) | depends(MESSAGES)) - {"depth_pose_msgs"}
    assert depends(ROOT) == both, "the manifest at the top is what rosdep installs for both packages"


def test_what_the_sources_import_is_in_the_list():
    names = {PACKAGES.get(name, name) for name in imported()}
    ours = {name for name in names if not re.fullmatch(ROS, name)}
    assert (
        set(NOBLE) | {"threadpoolctl", "mcap", "numba", "onnxruntime", "pillow", "typer", "rosbags"} <= ours
    )
    listed = requirements("dependencies", *sorted(set(EXTRAS.values())), "remote")
    ours |= {"open3d", "libusb-package"}  # core/open3d.py imports them by their names
    assert ours - set(listed) == set(BROUGHT)
    for name, by in BROUGHT.items():
        assert any(re.match(rf"{name}\b", line) for line in requires(by)), f"{by} no longer brings {name}"


def test_each_extra_installs_what_asks_for_it():
    for module, extra in EXTRAS.items():
        assert PACKAGES.get(module, module) in requirements(extra)


def test_the_manual_installs_the_list():
    text = (ROOT / "docs" / "topics.md").read_text()
    assert "requirements.py dependencies >/tmp/depth_pose.txt" in text
    assert "pip install -r /tmp/depth_pose.txt" in text
    lines = re.findall(r"^(?:\$ )?(?:\S*/)?pip3? install (.*)$", text, re.MULTILINE)
    assert lines
    for line in lines:
        assert line.startswith("-r "), "a list of its own would drift"


def test_open3d_has_wheels_on_both_architectures():
    wanted = requirements("sim")
    assert wanted["open3d"] == wanted["open3d-cpu"] == ">=0.19,<0.21"  # 0.20 is the first for arm64
    assert "libusb-package" in wanted  # which 0.20 wants from the system


def test_ros_packages_are_declared():
    """Every ROS package that the sources import stands in package.xml."""
    text = "\n".join(p.read_text() for p in (ROOT / "src" / "depth_pose" / "ros").rglob("*.py"))
    found = set(re.findall(r"^\s*(?:from|import) (rclpy|\w+_(?:msgs|interfaces))\b", text, re.MULTILINE))
    assert {"rclpy", "sensor_msgs", "lifecycle_msgs"} <= found
    optional = {"tf2_msgs", "hri_msgs", "vision_msgs", "people_msgs"}  # used only where they are there
    assert found - optional <= depends(PACKAGE)
