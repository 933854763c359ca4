"""The set-up's scripts: what they say where something is missing, and that they leave things alone."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "launch_scripts"
HELPERS = SCRIPTS / "helpers"


def bash(script, path, **environment):
    return subprocess.run(
        ["/bin/bash", "-c", script],
        cwd=ROOT,
        env={"PATH": str(path), "HOME": os.environ.get("HOME", "/"), **environment},
        capture_output=True,
        text=True,
        timeout=300,
    )


def find_python(path, **environment):
    script = "set -eu; source {0}/console.sh; source {0}/find_python.sh; find_python; echo found $python"
    return bash(script.format(HELPERS), path, **environment)


@pytest.fixture
def tools(tmp_path):
    """A path with what every Debian has, and no Python or compiler."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in (
        "date",
        "bash",
        "uname",
        "flock",
        "sha256sum",
        "cut",
        "cat",
        "mkdir",
        "rm",
        "find",
        "dirname",
    ):
        (folder / name).symlink_to(shutil.which(name))
    return folder


def program(folder, name, text):
    path = folder / name
    path.write_text(f"#!/bin/bash\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


def python(folder, name, prelude=""):
    """This Python, after a few lines of Python have run."""
    exe = f"exec /usr/bin/env _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 {sys.executable}"
    if not prelude:
        return program(folder, name, f'{exe} "$@"')
    (folder / "prelude.py").write_text(prelude + "\n")
    # programs come as `-c TEXT` or on stdin
    run = f'{{ cat {folder}/prelude.py; if [ "$1" = -c ]; then echo "$2"; else cat; fi; }} | {exe} -'
    return program(folder, name, run)


@pytest.mark.parametrize(
    "script", sorted(SCRIPTS.rglob("*.sh")) + [ROOT / ".ci" / "run"], ids=lambda p: p.name
)
def test_bash_can_read_it(script):
    subprocess.run(["/bin/bash", "-n", script], check=True)


def test_no_python_names_the_apt_line(tools):
    done = find_python(tools)
    assert done.returncode == 1
    assert "sudo apt-get install -y python3 python3-venv python3-dev g++" in done.stderr


def test_shims_that_lead_nowhere_are_passed_over(tools):
    program(tools, "python3.12", "echo 'python3.12: command not found' >&2; exit 127")
    program(tools, "g++", "")
    python(tools, "python3")
    done = find_python(tools)
    assert done.stdout.split() == ["found", "python3"], done.stderr


def test_too_new_a_python_is_passed_over(tools):
    python(tools, "python3", "import sys; sys.version_info = (3, 13, 0)")
    done = find_python(tools)
    assert done.returncode == 1
    assert "No usable Python 3.10, 3.11 or 3.12" in done.stderr


@pytest.mark.parametrize(
    ("prelude", "compiler", "missing"),
    [
        ("import sys; sys.modules['ensurepip'] = None", True, "{0}-venv"),
        ("import sysconfig; sysconfig.get_path = lambda name: '/nowhere'", True, "{0}-dev"),
        ("", False, "g++"),
        ("import sys; sys.modules['ensurepip'] = None", False, "{0}-venv g++"),
    ],
    ids=["venv", "headers", "compiler", "two"],
)
def test_missing_parts_are_named_in_one_apt_line(tools, prelude, compiler, missing):
    python(tools, "python3", prelude)
    if compiler:
        program(tools, "g++", "")
    done = find_python(tools)
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].strip() == (
        f"sudo apt-get update && sudo apt-get install -y {missing.format(version)}"
    )


def test_another_python_can_be_named(tools, tmp_path):
    program(tools, "g++", "")
    python(tmp_path, "mine")
    done = find_python(tools, DEPTH_POSE_PYTHON=str(tmp_path / "mine"))
    assert done.stdout.split() == ["found", str(tmp_path / "mine")], done.stderr


def test_requirements_come_from_pyproject():
    done = subprocess.run(
        [sys.executable, HELPERS / "requirements.py", "numpy", "ros", "sim", "dependencies"],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = done.stdout.splitlines()
    assert lines[0].startswith("numpy>=")
    assert "ros-jazzy-rclpy==7.1.6" in lines
    assert any(line.startswith("open3d-cpu>=0.19") for line in lines)


def test_an_environment_of_the_user_s_is_left_alone(tmp_path):
    copy = tmp_path / "project"
    shutil.copytree(SCRIPTS, copy / "launch_scripts")
    (copy / ".venv").mkdir()
    (copy / ".venv" / "mine").touch()
    done = subprocess.run(["/bin/bash", copy / "launch_scripts" / "setup.sh"], capture_output=True, text=True)
    assert done.returncode == 1
    assert "was not made by this script" in done.stderr
    assert (copy / ".venv" / "mine").exists()


def test_unknown_options_and_recordings_are_refused():
    done = subprocess.run(["/bin/bash", SCRIPTS / "setup.sh", "--tests"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "setup.sh knows no option --tests; it has --test\n")
    for arguments in (["nothing.mcap"], ["--view", "nothing.mcap"]):
        done = subprocess.run(["/bin/bash", SCRIPTS / "demo.sh", *arguments], capture_output=True, text=True)
        assert done.returncode == 1
        assert "There is no recording nothing.mcap" in done.stderr


def test_a_failed_job_shows_its_last_words(tmp_path):
    script = (
        f"source {HELPERS}/console.sh; (echo first; echo the reason; exit 3) >{tmp_path}/job.log & "
        f"job_pids[job]=$!; run_jobs {tmp_path}; echo went on"
    )
    done = bash(script, os.environ["PATH"])
    assert done.returncode == 1
    assert "job failed" in done.stderr
    assert "the reason" in done.stderr
    assert "went on" not in done.stdout


@pytest.fixture
def project(tmp_path):
    """The scripts, with a Python that notes that it was called."""
    copy = tmp_path / "project"
    shutil.copytree(SCRIPTS, copy / "launch_scripts")
    (copy / ".venv" / "bin").mkdir(parents=True)
    program(copy / ".venv" / "bin", "python", "cat >>programs")
    for folder in ("depth_pose_logs", "depth_pose_stamps"):
        (copy / ".venv" / folder).mkdir()
    return copy


def prepare(project):
    """Call it; return the programs that Python has been given so far."""
    script = "set -euo pipefail; source launch_scripts/helpers/console.sh; "
    script += "source launch_scripts/helpers/prepare.sh; prepare"
    subprocess.run(["/bin/bash", "-c", script], cwd=project, check=True)
    return (project / "programs").read_text()


def test_the_kernels_are_compiled_once(project):
    for _ in range(2):
        assert prepare(project).count("Tracker(quiet=True)") == 1
    (project / ".venv" / "depth_pose_stamps" / "kernels").unlink()
    program(project / ".venv" / "bin", "python", "exit 1")
    prepare(project)  # nothing else comes to harm
    assert not (project / ".venv" / "depth_pose_stamps" / "kernels").exists()
