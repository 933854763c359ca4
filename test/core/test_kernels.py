"""The cache of compiled kernels: where it is, and what becomes of damaged files in it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import depth_pose
from depth_pose.core.private_folder import is_writable, private_folder

_KERNEL = """
import os, sys
from depth_pose.core.kernels import njit

@njit(cache=True)
def add_up(n):
    total = 0
    for i in range(n):
        total += i * i
    return total

print(add_up(10), sum(add_up.stats.cache_hits.values()), os.environ.get("NUMBA_CACHE_DIR"))
"""


def _run(script: Path, **environment: str) -> list[str]:
    """Run the kernel in a process of its own; gives its answer, cache hits, and the cache's folder."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")}
    path = str(Path(depth_pose.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=120,
        env={**inherited, "PYTHONPATH": path, **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return done.stdout.split()


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("script") / "kernel.py"
    path.write_text(_KERNEL)
    return path


@pytest.fixture(scope="module")
def whole(script: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with the kernel in it."""
    folder = tmp_path_factory.mktemp("whole") / "cache"
    assert _run(script, NUMBA_CACHE_DIR=str(folder))[:2] == ["285", "0"]
    assert _run(script, NUMBA_CACHE_DIR=str(folder))[:2] == ["285", "1"]
    return folder


def _cut(content: bytes) -> bytes:
    return content[: len(content) // 2]


def _flip(content: bytes) -> bytes:
    changed = bytearray(content)
    changed[len(content) // 2] ^= 0x10
    return bytes(changed)


def _swap_code(content: bytes) -> bytes:
    """Spoil the compiled code, which the pickle around it does not notice."""
    at = content.index(b"\x7fELF")
    return content[: at + 100] + bytes(200) + content[at + 300 :]


@pytest.mark.parametrize(
    ("endings", "damage"),
    [
        ((".nbi", ".nbc"), _cut),
        ((".nbc",), _cut),
        ((".nbi",), _cut),
        ((".nbc",), _flip),
        ((".nbi",), _flip),
        ((".nbc",), _swap_code),
        ((".nbi", ".nbc"), lambda content: b""),
        ((".nbi", ".nbc"), lambda content: bytes(len(content))),
    ],
)
def test_a_damaged_cache_is_made_anew(
    script: Path, whole: Path, tmp_path: Path, endings: tuple[str, ...], damage: Callable[[bytes], bytes]
) -> None:
    folder = Path(shutil.copytree(whole, tmp_path / "cache"))
    files = [file for ending in endings for file in folder.rglob(f"*{ending}")]
    assert len(files) == len(endings)
    for file in files:
        file.write_bytes(damage(file.read_bytes()))
    assert _run(script, NUMBA_CACHE_DIR=str(folder))[:2] == ["285", "0"]
    assert _run(script, NUMBA_CACHE_DIR=str(folder))[:2] == ["285", "1"]


def test_where_nothing_can_be_written_a_private_folder_serves(script: Path, tmp_path: Path) -> None:
    """Not even by root: /proc takes no files."""
    for hits in ("0", "1"):
        answer = _run(script, NUMBA_CACHE_DIR="/proc/nothing", TMPDIR=str(tmp_path))
        assert answer == ["285", hits, str(tmp_path / f"depth_pose-{os.geteuid()}" / "kernels")]
    assert (tmp_path / f"depth_pose-{os.geteuid()}").stat().st_mode & 0o077 == 0


def test_a_private_folder_is_nobody_elses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    own = private_folder("a")
    assert own == tmp_path / f"depth_pose-{os.geteuid()}" / "a"
    own.parent.chmod(0o777)  # anybody could put files there
    other = private_folder("a")
    assert other is not None
    assert other.parent != own.parent
    assert other.parent.stat().st_mode & 0o077 == 0
    own.rmdir()
    own.parent.rmdir()
    own.parent.symlink_to(tmp_path / "elsewhere")
    third = private_folder("a")
    assert third is not None
    assert third.parent not in (own.parent, tmp_path / "elsewhere")
    monkeypatch.setattr("tempfile.tempdir", "/proc/nothing")
    assert private_folder("a") is None
    assert not is_writable(Path("/proc/nothing"))


_CALLS_ANOTHER = """
from depth_pose.core import kernels
from depth_pose.core.kernels import njit

read = []
parse = kernels.llvm.parse_bitcode
kernels.llvm.parse_bitcode = lambda code: read.append(code) or parse(code)

@njit(cache=True)
def double(values):
    return 2.0 * values

@njit(cache=True, forceinline=True)
def add_up(values):
    return double(values).sum()

import numpy as np
print(double(np.ones(3)).sum(), add_up(np.ones(4)), len(read))
"""


def test_a_kernel_that_is_compiled_calls_one_from_the_cache(tmp_path: Path) -> None:
    """What a cached kernel gives to others is read when one is compiled that calls it, and not before."""
    script, cache = tmp_path / "kernel.py", tmp_path / "cache"
    script.write_text(_CALLS_ANOTHER)
    for said in ("0", "0"):  # compiled, and loaded
        assert _run(script, NUMBA_CACHE_DIR=str(cache)) == ["6.0", "8.0", said]
    for file in cache.rglob("*add_up*"):
        file.unlink()
    assert _run(script, NUMBA_CACHE_DIR=str(cache)) == ["6.0", "8.0", "1"]
    assert _run(script, NUMBA_CACHE_DIR=str(cache)) == ["6.0", "8.0", "0"]
