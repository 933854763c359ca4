"""The checks of style and types, as tests, so that pytest's last line speaks for everything."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def _check(*command):
    module = command[0]
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed; it comes with the extra `test`")
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_lint():
    _check("ruff", "check", ".")


def test_format():
    _check("ruff", "format", "--check", ".")


def test_types():
    _check("mypy")
