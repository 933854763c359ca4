"""The checks of style, types and arrows, as tests, so that pytest's last line speaks for everything."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def _check(*command):
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_lint():
    _check("ruff", "check", ".")


def test_format():
    _check("ruff", "format", "--check", ".")


def test_types():
    _check("mypy")


def test_arrows_run_one_way():
    """`pyproject.toml` has the house: who may import whom, and no circle of files."""
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
