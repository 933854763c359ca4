"""Without the extras: the main job needs none of them, and what needs one says which, in one line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from command import environment
from depth_pose.core.camera import Camera
from depth_pose.core.extras import EXTRAS
from depth_pose.io.mcap_write import DepthWriter

WITHOUT = """
import sys
for name in {gone!r}:
    sys.modules[name] = None  # as where it is not installed
sys.argv = ["depth-pose", *{arguments!r}]
from depth_pose.cli import main
try:
    main()
finally:
    print("imported:", *(n for n in {watched!r} if sys.modules.get(n) is not None))
"""

GONE = (*EXTRAS, "onnx", "torch", "fsspec", "aiohttp", "rclpy", "pycpd", "mcap_ros2", "bvhio")
"""All that ``depth-pose run`` needs not."""

PARTS = tuple(
    f"depth_pose.{name}" for name in ("volume", "sim", "evaluate", "export", "archive", "ros", "viewer")
)


def _call(bank: Path, *arguments: Path | str) -> subprocess.CompletedProcess[str]:
    code = WITHOUT.format(gone=GONE, arguments=[*map(str, arguments)], watched=GONE)
    return subprocess.run(
        [sys.executable, "-c", code],
        env=environment(DEPTH_POSE_BANK=str(bank)),
        capture_output=True,
        text=True,
        timeout=300,
    )


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("in") / "in.mcap"
    with DepthWriter(path, Camera(64, 48, 60.0, 60.0, 31.5, 23.5), "optical") as writer:
        for i in range(3):
            writer.write(i * 40_000_000, np.full((48, 64), 2.0, np.float32))
    return path


def test_run_needs_no_extra(recording: Path, tmp_path: Path, bank_path: Path) -> None:
    done = _call(bank_path, "run", recording, "-o", tmp_path / "out.mcap")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "imported:"


def test_the_pipeline_imports_no_optional_part() -> None:
    code = f"import sys, depth_pose.offline; print([name for name in {PARTS} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr


@pytest.mark.parametrize(
    ("arguments", "module"),
    [
        (("overlay", "IN", "IN", "-o", "OUT/a.png"), "matplotlib"),
        (("bank", "info", "--sheet", "OUT/a.png"), "matplotlib"),
        (("view", "IN"), "viser"),
        (("run", "IN", "IN", "-o", "OUT/out", "--cluster", "tcp://127.0.0.1:1"), "distributed"),
        (("bank", "build", "-o", "OUT/b.npz", "--body", "me.glb"), "pygltflib"),
        (("bank", "build", "-o", "OUT/b.npz", "--body", "anny"), "anny"),
        (("bank", "build", "-o", "OUT/b.npz"), "open3d"),
        (("simulate", "-o", "OUT/sim.mcap"), "open3d"),
        (("simulate", "-o", "OUT/sim.mcap", "--room"), "open3d"),
        (("run", "https://127.0.0.1:1/a.mcap", "-o", "OUT/out"), "fsspec"),
    ],
)
def test_what_needs_an_extra_names_it(
    arguments: tuple[str, ...], module: str, recording: Path, tmp_path: Path, bank_path: Path
) -> None:
    (tmp_path / "other.mcap").write_bytes(recording.read_bytes())
    named = {"IN": str(recording)}
    given = [named.get(a, a.replace("OUT", str(tmp_path))) for a in arguments]
    if arguments.count("IN") == 2 and arguments[0] == "run":
        given[2] = str(tmp_path / "other.mcap")
    done = _call(bank_path, *given)
    extra = EXTRAS.get(module, "remote")
    assert done.returncode in (1, 2)
    (line,) = done.stderr.splitlines()
    assert module in line and f"pip install 'depth_pose[{extra}]'" in line
