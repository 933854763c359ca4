"""The library, run, export and view without what only Linux and macOS have, as on Windows."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from command import environment
from depth_pose.core.errors import InputError
from depth_pose.core.outputs import own_folder, remove_parts
from depth_pose.core.workers import without_interrupts
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.io.mcap_write import DepthWriter

AS_ON_WINDOWS = """
import os, signal, sys
# other libraries ask for them as well, and have their own ways without
import asyncio, getpass, multiprocessing.connection, random, subprocess, tempfile, threading
import mcap, numba, numpy, onnxruntime, PIL.Image, rich.console, rosbags, scipy.optimize, typer, viser, yaml
gone = ("fcntl", "resource", "termios", "pwd", "grp", "pty", "tty", "syslog")
for name in gone:
    sys.modules[name] = None
for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_DIRECTORY", "getuid", "geteuid", "getgid", "getegid",
             "sched_getaffinity", "fork", "statvfs", "chown", "mkfifo", "getpgid", "setsid", "killpg"):
    delattr(os, name)
for name in ("pthread_sigmask", "sigwait", "SIGHUP", "SIGKILL", "SIGALRM", "SIGUSR1"):
    delattr(signal, name)
"""

SIX_LINES = """
import depth_pose
from depth_pose.detect.sample_frame import sample_frame
frame = sample_frame()
tracker = depth_pose.Tracker(sys.argv[1], quiet=True)
(person,) = tracker(frame.depth, frame.camera, time=0.0)
assert person.id == "body_1" and person["left_wrist"].confidence > 0.0
"""

COMMANDS = """
from depth_pose.cli import main
for line in sys.argv[1:]:
    sys.argv = ["depth-pose", *line.split()]
    try:
        main()
    except SystemExit as end:
        assert not end.code, (line, end.code)
"""

VIEW = """
from pathlib import Path
from urllib.request import urlopen
from depth_pose.cli.view import recorded_source
from depth_pose.viewer.app import Viewer
recording, skeletons, bank = map(Path, sys.argv[1:])
source = recorded_source(recording, skeletons, bank, None, "/depth_pose/skeletons", 1000)
source.start()
viewer = Viewer(source, host="127.0.0.1", port=0, pictures=recording.parent)
page = urlopen(f"http://127.0.0.1:{viewer.port}", timeout=30.0).read()
viewer.stop()
source.stop()
assert b"<html" in page.lower()
"""


def as_on_windows(code: str, *arguments: Path | str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", AS_ON_WINDOWS + code, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=400,
        env=environment(),
    )
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path, frame = tmp_path_factory.mktemp("in") / "in.mcap", sample_frame()
    with DepthWriter(path, frame.camera, "optical") as writer:
        for i in range(3):
            writer.write((i + 1) * 40_000_000, frame.depth)
    return path


def test_six_lines(bank_path: Path) -> None:
    as_on_windows(SIX_LINES, bank_path)


def test_run_export_and_view(recording: Path, bank_path: Path, tmp_path: Path) -> None:
    one, many = tmp_path / "one.mcap", f"{tmp_path}/many/"
    other = tmp_path / "other.mcap"
    other.write_bytes(recording.read_bytes())
    as_on_windows(
        COMMANDS,
        f"run {recording} -o {one} --bank {bank_path}",
        f"run {recording} {other} -o {many} --bank {bank_path} --workers 0",
        f"export {one} -o {tmp_path}/joints.csv",
        f"export {one} -o {tmp_path}/motion.bvh",
    )
    written = sorted(p.name for p in tmp_path.iterdir())
    assert written == ["joints.csv", "many", "motion.bvh", "one.mcap", "other.mcap"]
    assert {"in.mcap", "other.mcap", "report.csv"} <= {p.name for p in (tmp_path / "many").iterdir()}
    as_on_windows(VIEW, recording, one, bank_path)


def test_without_locks_what_was_left_is_removed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    left = tmp_path / ".a.npz.0123456789ab.part"
    for has_locks in (True, False):
        monkeypatch.setattr("depth_pose.core.outputs.HAS_LOCKS", has_locks)
        left.write_bytes(b"")
        remove_parts([tmp_path / "a.npz"])
        assert not left.exists()


def test_without_masks_of_signals_workers_start_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    with without_interrupts():  # Python's own workers need the mask here, so none is started
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    monkeypatch.delattr(signal, "pthread_sigmask")
    with without_interrupts():
        pass


def test_with_locks_a_folder_is_taken_once(tmp_path: Path) -> None:
    with own_folder(tmp_path), pytest.raises(InputError, match="another command"), own_folder(tmp_path):
        np.testing.assert_(False)
