"""The cache of compiled kernels: where it is, and what happens to it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import depth_pose
from depth_pose.core.private_folder import is_private, is_writable, private_folder

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
        [sys.executable, script], capture_output=True, text=True, timeout=300,
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


def test_what_is_compiled_is_kept_where_the_user_says(script: Path, tmp_path: Path) -> None:
    for hits in ("0", "1"):
        assert _run(script, NUMBA_CACHE_DIR=str(tmp_path)) == ["285", hits, str(tmp_path)]


@pytest.mark.parametrize(("kind", "damage"), [("nbi", b""), ("nbc", b"\0" * 4096), ("nbc", b"\x80\x05\x95")])
def test_a_damaged_cache_is_compiled_again(script: Path, tmp_path: Path, kind: str, damage: bytes) -> None:
    """A power cut leaves empty files, zeros or a part."""
    _run(script, NUMBA_CACHE_DIR=str(tmp_path))
    [file] = tmp_path.rglob(f"*.{kind}")
    file.write_bytes(damage)
    for hits in ("0", "1"):
        assert _run(script, NUMBA_CACHE_DIR=str(tmp_path)) == ["285", hits, str(tmp_path)]


def test_what_a_full_disk_does_not_take_is_compiled_again(tmp_path: Path) -> None:
    full, script = tmp_path / "full.py", tmp_path / "kernel.py"
    limit = """
import resource, signal, sys
sys.dont_write_bytecode = True
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # else it ends the process
resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
"""
    script.write_text(_KERNEL)
    full.write_text(_KERNEL.replace("print(", f"{limit}print("))
    cache = tmp_path / "cache"
    assert _run(full, NUMBA_CACHE_DIR=str(cache)) == ["285", "0", str(cache)]
    assert not list(cache.rglob("*.nb*"))
    for hits in ("0", "1"):
        assert _run(script, NUMBA_CACHE_DIR=str(cache)) == ["285", hits, str(cache)]


def test_without_any_folder_each_process_compiles(tmp_path: Path) -> None:
    script = tmp_path / "kernel.py"
    script.write_text("import tempfile\ntempfile.tempdir = '/proc/nothing'\n" + _KERNEL)
    for _ in range(2):
        assert _run(script, NUMBA_CACHE_DIR="/proc/nothing") == ["285", "0", "/proc/nothing"]


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


def test_it_is_known_whether_a_kernel_is_compiled(script: Path, tmp_path: Path) -> None:
    asking = tmp_path / "kernel.py"
    text = script.read_text().replace("import njit", "import is_compiled, njit")
    asking.write_text(
        text.replace("print(", "before = is_compiled(add_up)\nprint(before, ") + "print(is_compiled(add_up))"
    )
    cache = tmp_path / "cache"
    assert [_run(asking, NUMBA_CACHE_DIR=str(cache))[i] for i in (0, -1)] == ["False", "True"]
    assert _run(asking, NUMBA_CACHE_DIR=str(cache))[0] == "True"
    asking.write_text(asking.read_text().replace("i * i", "i * 3"))  # another source
    assert _run(asking, NUMBA_CACHE_DIR=str(cache))[0] == "False"


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o775, 0o1777])
def test_a_cache_that_others_may_write_to_is_not_used(script: Path, tmp_path: Path, mode: int) -> None:
    """Its files are executed. The group's number is not the user's."""
    shared, own = tmp_path / "shared", tmp_path / "own"
    for folder in (shared, own):
        folder.mkdir()
    shared.chmod(mode)
    if os.geteuid() == 0:
        os.chown(shared, 0, 12345)
    elif os.getegid() == os.geteuid() and not mode & 0o007:
        return
    answer = _run(script, NUMBA_CACHE_DIR=str(shared), TMPDIR=str(own))
    assert answer == ["285", "0", str(own / f"depth_pose-{os.geteuid()}" / "kernels")]
    assert not list(shared.iterdir())


def test_who_may_write_to_a_folder_or_above_it(tmp_path: Path) -> None:
    folder = tmp_path / "above" / "cache"
    folder.mkdir(parents=True)
    assert is_private(folder) and not is_private(tmp_path / "missing")
    folder.parent.chmod(0o777)
    assert not is_private(folder)
    folder.parent.chmod(0o1777)
    assert is_private(folder)
    if os.geteuid() == 0:  # another account's
        os.chown(folder, 12345, 0)
        assert not is_private(folder)
