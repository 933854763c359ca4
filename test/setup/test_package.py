"""What pip installs: the wheel and the source archive, and the library in a clean environment."""

import os
import re
import subprocess
import sys
import zipfile
from importlib.metadata import Distribution, PathDistribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MOST_WHEEL_MB = 17.0


def run(*command, **environment):
    done = subprocess.run(
        [*map(str, command)],
        capture_output=True,
        text=True,
        timeout=1200,
        cwd=environment.pop("cwd", None),
        env={**os.environ, **environment},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    """The wheel and the source archive, built as a release builds them."""
    folder = tmp_path_factory.mktemp("dist")
    source = folder / "source"
    tracked = run("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", cwd=ROOT).split("\0")
    for name in filter(None, tracked):
        if (ROOT / name).is_file() and not (ROOT / name).is_symlink():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, source)
    (wheel,) = folder.glob("*.whl")
    (sdist,) = folder.glob("*.tar.gz")
    return wheel, sdist


@pytest.fixture(scope="module")
def metadata(archives, tmp_path_factory) -> Distribution:
    folder = tmp_path_factory.mktemp("wheel")
    with zipfile.ZipFile(archives[0]) as wheel:
        wheel.extractall(folder)
    return PathDistribution(next(folder.glob("*.dist-info")))


def test_the_index_takes_both(archives):
    said = run(sys.executable, "-m", "twine", "check", "--strict", *archives)
    assert said.count("PASSED") == 2


def test_the_wheel_holds_the_package_and_its_data(archives, metadata):
    wheel = archives[0]
    assert wheel.stat().st_size < 1e6 * MOST_WHEEL_MB
    assert wheel.name.endswith("py3-none-any.whl")
    held = {str(file) for file in metadata.files}
    package = ROOT / "src" / "depth_pose"
    wanted = {p for p in package.rglob("*.*") if p.is_file() and p.parent.name != "__pycache__"}
    assert {f"depth_pose/{p.relative_to(package)}" for p in wanted if p.suffix != ".pyc"} <= held
    assert all(name.startswith(("depth_pose/", "depth_pose-")) for name in held)


def test_pip_installs_one_program(metadata):
    assert [entry.name for entry in metadata.entry_points] == ["depth-pose"]


def test_nothing_of_ros_is_needed_without_the_extra(metadata):
    needed = [line for line in metadata.requires if "extra ==" not in line]
    assert needed and not any(re.match(r"ros-|rclpy|viser|distributed|torch|open3d", line) for line in needed)
    extras = set(metadata.metadata.get_all("Provides-Extra"))
    assert "ros" not in extras  # its messages come from no index
    assert {"sim", "view", "pictures", "dask", "train", "pandas", "remote", "anny", "docs"} <= extras


def test_links_of_the_readme_lead_somewhere_on_an_index(metadata):
    text = metadata.metadata.get_payload()
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert len(links) > 5
    assert all(link.startswith(("https://", "#")) for link in links), links
    labels = {line.partition(",")[0] for line in metadata.metadata.get_all("Project-URL")}
    assert {"Homepage", "Documentation", "Changelog", "Issues"} <= labels


@pytest.mark.slow
def test_six_lines_in_a_clean_environment(archives, tmp_path):
    """Installed from the index into an environment of its own: no ROS, no compiler, nothing of ours."""
    environment = {"PYTHONPATH": "", "PATH": "/nowhere", "XDG_CACHE_HOME": str(tmp_path / "cache")}
    run(sys.executable, "-m", "venv", tmp_path / "venv", _ROS_WHEELS_BOOTSTRAP_COMPLETE="1")
    python = tmp_path / "venv" / "bin" / "python"
    run(python, "-m", "pip", "install", "--no-compile", archives[0], PYTHONPATH="")
    lines = Path(__file__).parent / "six_lines.py"
    said = run(python, lines, cwd=tmp_path, **environment)
    assert [line.split()[0] for line in said.splitlines()] == ["body_1"] * 3
