"""What the commands do to files: nothing that is there is lost, and trouble is said before the work."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import depth_pose
from command import Done, caller, environment
from depth_pose.core import workers
from depth_pose.core.camera import Camera
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.io.skeleton_read import read_people

_CTRL_C_AT_THE_TENTH = """
import importlib, os, signal, sys
from depth_pose.cli import main
from depth_pose.pipeline import PosePipeline
name, method = sys.argv.pop(1).rsplit(".", 1)
module, kind = name.rsplit(".", 1)
kind = getattr(importlib.import_module(module), kind)
called, calls = getattr(kind, method), iter(range(1, 1000))
def with_ctrl_c(*arguments, **options):
    if next(calls) == 10:
        os.kill(os.getpid(), signal.SIGINT)
    return called(*arguments, **options)
setattr(kind, method, with_ctrl_c)
PosePipeline.warm_up = lambda self: None  # kernels that nobody needs where nobody is seen
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job has it ignored
main()
"""

_CTRL_C_AT_AN_IMPORT = """
import os, re, signal, sys
from importlib.abc import MetaPathFinder
module = sys.argv.pop(1)
signal.signal(signal.SIGINT, signal.SIG_IGN if module == "ignored" else signal.default_int_handler)
class Finder(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == module or module == "ignored" and name == "typer":
            os.kill(os.getpid(), signal.SIGINT)
            sys.stdout.write("sent")
            sys.stdout.flush()
sys.meta_path.insert(0, Finder())
from depth_pose.cli import main
sys.exit(main())
"""


_CTRL_C_IN_A_CALLBACK = """
import ctypes, os, signal
from depth_pose.cli import main
from depth_pose.pipeline import PosePipeline
signal.signal(signal.SIGINT, signal.default_int_handler)
def called_by_the_compiler():
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass
PosePipeline.warm_up = lambda self: ctypes.CFUNCTYPE(None)(called_by_the_compiler)()
main()
"""


def _command(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "depth_pose.cli", *map(str, arguments)]


def _call(*arguments: str | Path, cwd: Path | None = None, **more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        _command(*arguments),
        capture_output=True,
        text=True,
        errors="replace",
        timeout=300,
        cwd=cwd,
        env=environment(**more),
    )


def _call_with_ctrl_c(module: str, *arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", _CTRL_C_AT_AN_IMPORT, module, *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=300, cwd=cwd, env=environment(), check=False
    )


def _record(path: Path, frames: int = 1) -> Path:
    with DepthWriter(path, Camera(64, 48, 60.0, 60.0, 31.5, 23.5), "optical") as writer:
        for i in range(frames):
            writer.write(1 + i * 40_000_000, np.full((48, 64), 2.0, np.float32))
    return path


def _is_one_line(done: subprocess.CompletedProcess[str], says: str) -> None:
    assert done.returncode in (1, 2), done.stdout + done.stderr
    assert says in done.stderr, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr


def test_run_never_writes_over_what_it_reads(tmp_path: Path, bank_path: Path) -> None:
    recording = _record(tmp_path / "in.mcap")
    before = recording.read_bytes()
    (tmp_path / "link.mcap").symlink_to(recording)
    os.link(recording, tmp_path / "hard.mcap")
    for output in ("in.mcap", "./in.mcap", "link.mcap", "hard.mcap"):
        done = _call("run", "in.mcap", "-o", output, "--bank", bank_path, cwd=tmp_path)
        _is_one_line(done, "both read and to be written")
    done = _call("run", "in.mcap", "-o", ".", "--bank", bank_path, cwd=tmp_path)  # as an archive
    _is_one_line(done, "both read and to be written")
    done = _call("run", "in.mcap", "-o", "o.mcap", "--save-build", "in.mcap", cwd=tmp_path)
    _is_one_line(done, "both read and to be written")
    assert recording.read_bytes() == before
    assert not (tmp_path / "o.mcap").exists()


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    return caller(monkeypatch, capsys)


@pytest.mark.parametrize("arguments", [
    ("run", "in.mcap", "-o", "{a.yaml}", "--params", "a.yaml"),
    ("run", "in.mcap", "-o", "{b.npz}", "--bank", "b.npz"),
    ("run", "in.mcap", "-o", "o.mcap", "--save-build", "{b.npz}", "--bank", "b.npz"),
    ("run", "in.mcap", "b.mcap", "-o", ".", "--workers", "0"),
    ("export", "in.mcap", "-o", "{in.mcap}"),
    ("bank", "build", "-o", "{b.npz}", "--body", "b.npz"),
    ("bank", "info", "b.npz", "--sheet", "{b.npz}"),
    ("bank", "check", "in.mcap", "-o", "{in.mcap}"),
    ("eval", "b.npz", "b.mcap", "--plot", "{b.npz}"),
    ("eval", "b.npz", "b.mcap", "--plot", "{b.mcap}"),
    ("overlay", "in.mcap", "b.mcap", "-o", "{in.mcap}"),
    ("overlay", "in.mcap", "b.mcap", "-o", "{b.mcap}"),
    ("volume", "run", "in.mcap", "-m", "b.npz", "--rig", "a.yaml", "-o", "{in.mcap}"),
    ("volume", "run", "in.mcap", "-m", "b.npz", "--rig", "a.yaml", "-o", "{a.yaml}"),
    ("volume", "demo", "-m", "b.npz", "-o", "{b.npz}"),
], ids=" ".join)  # fmt: skip
@pytest.mark.parametrize("by", ["symlink_to", "hardlink_to"])
def test_no_command_writes_over_what_it_reads(
    tmp_path: Path,
    arguments: tuple[str, ...],
    by: str,
    call: Callable[..., Done],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Recordings, banks, models and settings, under another name that ends as an output's does."""
    _record(tmp_path / "in.mcap")
    for name in ("b.mcap", "b.npz"):
        (tmp_path / name).write_bytes((tmp_path / "in.mcap").read_bytes() + name.encode())
    (tmp_path / "a.yaml").write_text("{}\n")
    ending = {"export": ".csv", "run": ".mcap"}.get(arguments[0], ".npz" if "build" in arguments else ".png")
    given = []
    for argument in arguments:
        if argument.startswith("{"):
            link = tmp_path / f"link{ending}"
            getattr(link, by)(tmp_path / argument.strip("{}"))
            argument = link.name
        given.append(argument)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    monkeypatch.chdir(tmp_path)
    done = call(*given)
    assert done.returncode == 1 and "both read and to be written" in done.stderr, done.stderr
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize("arguments", [
    ("run", "in.mcap", "-o", "{}"),
    ("simulate", "-o", "{}.mcap"),
    ("record", "-o", "{}"),
    ("bank", "build", "-o", "{}"),
    ("bank", "info", "--sheet", "{}"),
    ("bank", "check", "in.mcap", "-o", "{}"),
    ("eval", "a.npz", "b.mcap", "--plot", "{}"),
    ("overlay", "in.mcap", "b.mcap", "-o", "{}"),
    ("volume", "train", "-o", "{}"),
    ("volume", "run", "in.mcap", "-m", "a.npz", "--rig", "r.yaml", "-o", "{}"),
    ("volume", "demo", "-o", "{}"),
], ids=" ".join)  # fmt: skip
def test_every_writing_command_looks_at_its_target_first(
    tmp_path: Path,
    arguments: tuple[str, ...],
    call: Callable[..., Done],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What else is missing (a bank, a model, ROS) would be told first if the work began."""
    _record(tmp_path / "in.mcap")
    cases = {"/proc/nothing/x": "cannot be written", "in.mcap/x": "cannot be written"}
    if not arguments[-1].endswith(".mcap"):
        cases["/dev/null"] = "it is a device or a pipe"
        os.mkdir(tmp_path / "folder")
        if arguments[0] != "run":  # which takes it for an archive's
            cases["folder"] = "it is a folder"
    monkeypatch.chdir(tmp_path)
    for target, says in cases.items():
        done = call(*(a.format(target) for a in arguments))
        assert done.returncode == 1 and says in done.stderr, done.stderr
        assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != "folder") == ["in.mcap"]


@pytest.mark.parametrize(("arguments", "says"), [
    (("run", "in.mcap", "b.mcap", "-o", "new/out", "--bank", "no.npz"), "no.npz: no such bank"),
    (("run", "in.mcap", "b.mcap", "-o", "new/out", "--bank", "in.mcap"), "in.mcap"),
    (("run", "in.mcap", "b.mcap", "-o", "new/out", "--cluster", "tcp://127.0.0.1:9"), "127.0.0.1:9"),
    (("run", "in.mcap", "b.mcap", "-o", "new/o.mcap"), "o.mcap is a file's name"),
    (("run", "in.mcap", "b.mcap", "-o", "new/out", "--workers", "2", "--cluster", "x"), "give either"),
    (("run", "in.mcap", "-o", "new/out.mcap", "--bank", "no.npz"), "no.npz: no such bank"),
    (("run", "none.mcap", "-o", "new/out.mcap"), "none.mcap cannot be read"),
    (("overlay", "in.mcap", "b.mcap", "-o", "new/o.png"), "b.mcap"),
    (("export", "in.mcap", "-o", "new/o.csv"), "in.mcap"),
    (("volume", "run", "in.mcap", "-m", "no.npz", "--rig", "r.yaml", "-o", "new/o.mcap"), "cannot be read"),
    (("bank", "build", "-o", "new/b.npz", "--body", "no.npz"), "no.npz"),
], ids=lambda value: " ".join(value) if isinstance(value, tuple) else "")  # fmt: skip
def test_nothing_is_left_by_what_is_refused(
    tmp_path: Path,
    bank_path: Path,
    arguments: tuple[str, ...],
    says: str,
    call: Callable[..., Done],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No folder, no report without a line; and what an earlier run has left stays."""
    for name in ("in.mcap", "b.mcap"):
        _record(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))
    monkeypatch.setattr(workers, "CONNECT_S", "1s")
    for left in (["b.mcap", "in.mcap"], ["b.mcap", "in.mcap", "new", "new/out", "new/out/report.csv"]):
        done = call(*arguments)
        assert done.returncode in (1, 2) and says in done.stderr, done.stderr
        assert sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*")) == left
        (tmp_path / "new" / "out").mkdir(parents=True, exist_ok=True)
        (tmp_path / "new" / "out" / "report.csv").write_text("mine")
    assert (tmp_path / "new" / "out" / "report.csv").read_text() == "mine"


@pytest.mark.parametrize("arguments", [
    ("run", "pipe.mcap", "-o", "o.mcap"),
    ("run", "in.mcap", "-o", "o.mcap", "--bank", "pipe.npz"),
    ("run", "in.mcap", "-o", "o.mcap", "--params", "pipe.yaml"),
    ("run", "in.mcap", "-o", "o.mcap", "--build", "pipe.json"),
    ("run", "in.mcap", "b.mcap", "-o", "many", "--workers", "0", "--build", "pipe.json"),
    ("info", "pipe.mcap"),
    ("export", "pipe.mcap", "-o", "o.csv"),
    ("overlay", "in.mcap", "pipe.mcap", "-o", "o.png"),
    ("eval", "pipe.npz", "in.mcap"),
    ("bank", "info", "pipe.npz"),
    ("bank", "check", "pipe.mcap", "-o", "o.png"),
    ("simulate", "-o", "o.mcap", "--motion", "pipe.bvh"),
    ("volume", "info", "pipe.npz"),
    ("view", "pipe.mcap"),
    ("play", "pipe.mcap"),
    ("up", "--params", "pipe.yaml"),
], ids=" ".join)  # fmt: skip
def test_no_command_waits_for_a_pipe(
    tmp_path: Path,
    bank_path: Path,
    arguments: tuple[str, ...],
    call: Callable[..., Done],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("in.mcap", "b.mcap"):
        _record(tmp_path / name)
    for ending in ("mcap", "npz", "yaml", "json", "bvh"):
        os.mkfifo(tmp_path / f"pipe.{ending}")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))

    def end_it(*_: object) -> None:
        raise AssertionError(f"waits: {arguments}")

    before = signal.signal(signal.SIGALRM, end_it)
    signal.alarm(60)
    try:
        done = call(*arguments)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    told = done.stderr
    assert done.returncode in (1, 2) and "pipe." in told and "Traceback" not in told, told


@pytest.mark.parametrize("method", [
    "depth_pose.pipeline.PosePipeline.process_frame",
    "depth_pose.io.mcap_write.SkeletonWriter.write_people",
    "depth_pose.io.mcap_write.SkeletonWriter.write",
])  # fmt: skip
def test_ctrl_c_keeps_the_earlier_output(tmp_path: Path, bank_path: Path, method: str) -> None:
    recording = _record(tmp_path / "in.mcap", 30)
    (tmp_path / "out.mcap").write_bytes(b"good")
    arguments = [method, "run", recording, "-o", tmp_path / "out.mcap", "--bank", bank_path]
    command = [sys.executable, "-c", _CTRL_C_AT_THE_TENTH, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    assert done.returncode == 130, done.stderr
    assert "out.partial.mcap" in done.stderr.strip().splitlines()[-1]
    assert (tmp_path / "out.mcap").read_bytes() == b"good"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.mcap", "out.mcap", "out.partial.mcap"]
    assert 9 <= len(list(read_people(tmp_path / "out.partial.mcap"))) <= 10


@pytest.mark.parametrize("module", [
    "typer", "rich.console", "depth_pose.core.config", "depth_pose.cli.run",  # what each command imports
    "numpy", "depth_pose.io.mcap_read", "numba", "depth_pose.pipeline",  # what this one does
])  # fmt: skip
def test_ctrl_c_during_an_import(tmp_path: Path, bank_path: Path, module: str) -> None:
    _record(tmp_path / "in.mcap")
    done = _call_with_ctrl_c(module, "run", "in.mcap", "-o", "out.mcap", "--bank", bank_path, cwd=tmp_path)
    assert done.returncode == 130, done.stderr
    assert done.stderr.count("\n") <= 1 and "Traceback" not in done.stderr, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.mcap"]


def test_ctrl_c_while_kernels_compile(tmp_path: Path, bank_path: Path) -> None:
    """ctypes ignores an exception in a callback, as those of llvmlite: the command would go on."""
    arguments = ["run", _record(tmp_path / "in.mcap"), "-o", tmp_path / "out.mcap", "--bank", bank_path]
    command = [sys.executable, "-c", _CTRL_C_IN_A_CALLBACK, *map(str, arguments)]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=300, env=environment(), check=False
    )
    assert done.returncode == 130 and "Traceback" not in done.stderr, done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["in.mcap"]


def test_ctrl_c_is_ignored_where_the_shell_has_it_so(tmp_path: Path) -> None:
    done = _call_with_ctrl_c("ignored", "--version", cwd=tmp_path)
    assert done.returncode == 0 and depth_pose.__version__ in done.stdout, done.stderr
    assert done.stdout.startswith("sent")


def test_output_that_has_no_unicode(tmp_path: Path) -> None:
    name = "Übung→\udcff.mcap"
    for encoding in ("ascii", "latin-1", "utf-8"):
        done = _call("run", name, "-o", "out.mcap", cwd=tmp_path, PYTHONIOENCODING=encoding, LC_ALL="C")
        _is_one_line(done, "cannot be read")
    done = _call("simulate", "-o", "Größe.mcap", "--seconds", "0.04", "--motion", "wave",
                 cwd=tmp_path, PYTHONIOENCODING="ascii", LC_ALL="C")  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "Größe.mcap").exists()
    for what in (("info", "Größe.mcap"), ("--help",), ("run", "--help")):
        done = _call(*what, cwd=tmp_path, PYTHONIOENCODING="ascii", LC_ALL="C")
        assert done.returncode == 0 and not done.stderr, done.stderr
        assert done.stdout.isascii() and len(done.stdout) > 200


def test_nothing_needs_a_home(tmp_path: Path, bank_path: Path) -> None:
    """A service's account has none, or none that it can write."""
    homes = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR"), "/proc/nothing")
    homes |= {"TMPDIR": str(tmp_path)}
    for arguments in (
        ("simulate", "-o", "in.mcap", "--seconds", "0.08", "--motion", "wave"),
        ("run", "in.mcap", "-o", "out.mcap", "--bank", bank_path),
        ("eval", "in.npz", "out.mcap", "--plot", "plot.png"),
    ):
        done = _call(*arguments, cwd=tmp_path, **homes)
        assert done.returncode == 0, done.stderr
        assert "Traceback" not in done.stderr
    assert len(list(read_people(tmp_path / "out.mcap"))) == 2
    assert (tmp_path / "plot.png").stat().st_size > 10_000
