"""One version, wherever it stands."""

import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

import depth_pose

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "ros_ws" / "src" / "depth_pose"
MESSAGES = ROOT / "ros_ws" / "src" / "depth_pose_msgs"


def _of_pyproject() -> str:
    return re.search(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE).group(1)


def _of_package_xml(path: Path) -> str:
    return ElementTree.parse(path).findtext("version")


def _of_setup_py() -> str:
    """What setuptools, and so colcon, makes of setup.py."""
    done = subprocess.run(
        [sys.executable, "setup.py", "--quiet", "--version"],
        cwd=PACKAGE,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()[-1]


def _of_citation() -> str:
    return re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE).group(1)


def _of_changelog() -> str:
    return re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE).group(1)


@pytest.mark.parametrize(
    "found",
    [
        pytest.param(_of_pyproject, id="pyproject.toml"),
        pytest.param(lambda: _of_package_xml(ROOT / "package.xml"), id="package.xml"),
        pytest.param(lambda: _of_package_xml(PACKAGE / "package.xml"), id="package.xml of ros_ws"),
        pytest.param(lambda: _of_package_xml(MESSAGES / "package.xml"), id="depth_pose_msgs"),
        pytest.param(_of_changelog, id="CHANGELOG.md"),
        pytest.param(_of_citation, id="CITATION.cff"),
        pytest.param(_of_setup_py, id="setup.py"),
    ],
)
def test_version_is_the_package_s(found):
    assert found() == depth_pose.__version__


def test_maintainers_agree():
    # colcon silently takes a package with an invalid address for another kind of package
    manifests = (ROOT, PACKAGE, MESSAGES)
    emails = {ElementTree.parse(p / "package.xml").find("maintainer").get("email") for p in manifests}
    assert len(emails) == 1
    assert re.fullmatch(r"[^@\s]+@[^@\s]+\.[a-z]+", emails.pop())


def test_message_constants_are_the_core_s():
    from depth_pose.core.skeleton import JOINTS, JointState, Source

    states, sources = ({m.name: m.value for m in kind} for kind in (JointState, Source))
    places = {name.upper(): place for place, name in enumerate(JOINTS)}
    for name, wanted in (("Joint", states | places), ("Skeleton", sources)):
        text = (MESSAGES / "msg" / f"{name}.msg").read_text()
        constants = re.findall(r"^uint8 ([A-Z_]+)=(\d+)", text, re.MULTILINE)
        assert {k: int(v) for k, v in constants if not k.startswith("TRACK")} == wanted
