"""The benchmarks reach into the pipeline, where no other test would notice that one fails."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import simulate

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def test_every_stage_is_timed(bank_path, tmp_path):
    simulate(tmp_path / "clip.mcap", Person().body(), load_motion("stand_casual", 25.0, 0.6))
    command = [sys.executable, BENCHMARKS / "speed.py", tmp_path / "clip.mcap", "--bank", bank_path]
    environment = os.environ | {"PYTHONPATH": str(BENCHMARKS.parent / "src")}
    out = subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout
    rows = [[c.strip() for c in line.strip("| ").split("|")] for line in out.splitlines()[2:]]
    assert [row[:3] for row in rows] == [
        ["176x144", "1.0", method] for method in ("articulated", "speed: high", "cpd")
    ]
    for row in rows:
        *stages, total = (float(c.strip("*").split(" ")[0]) for c in row[3:11])
        assert min(stages[1:]) > 0.0  # where all are sure the finder rests in every second frame
        assert 0.5 * total < sum(stages) < 2.0 * total


COMMANDS = [
    ("speed.py",),
    *(("accuracy.py", part) for part in ("table1", "ablation", "confidence", "builds", "deviations")),
    ("finder.py",),
    *(("homes.py", part) for part in ("views", "cameras")),
    ("public.py",),
    ("faults.py",),
    ("drivers.py",),
    ("archives.py",),
    *(("angles.py", part) for part in ("angles", "gait", "constants")),
    ("by_tests.py",),
    ("reading.py",),
    *(("rooms.py", part) for part in ("calibration", "fusion", "constants")),
    *(("rooms_live.py", part) for part in ("merged", "live")),
    *(("volume.py", part) for part in ("dances", "live")),
    *(("banks.py", part) for part in ("match", "size", "views", "score", "coverage")),
]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_loads_and_says_what_it_does(command):
    """Names that it takes from the package are there; its page is named in the README beside it."""
    name, *part = command
    done = subprocess.run(
        [sys.executable, BENCHMARKS / name, *part, "--help"],
        env=os.environ | {"PYTHONPATH": str(BENCHMARKS.parent / "src")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "usage:" in done.stdout
    row = next(r for r in (BENCHMARKS / "README.md").read_text().splitlines() if f"| `{name}" in r)
    assert all(f"{p}`" in row for p in part)


def test_a_constant_changes_before_anything_is_derived_from_it() -> None:
    """Also in modules that copied it, and in processes that a process starts."""
    program = (
        "import subprocess, sys\n"
        "from depth_pose.io import image_folder\n"
        "from depth_pose.core.image_size import MAX_SIDE\n"
        "print(image_folder._FPS, '60 a second' in image_folder._NO_TIMES, MAX_SIDE)\n"
        "if sys.argv[1:]: subprocess.run([sys.executable, '-c', sys.argv[1]], check=True)\n"
    )
    paths = [BENCHMARKS / "parts" / "changed_constant", BENCHMARKS.parent / "src"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    environment["CHANGED_CONSTANT"] = "depth_pose.io.image_folder:_FPS:2.0"
    command = [sys.executable, "-c", program, program]
    out = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    assert out.split() == ["60.0", "True", "8192"] * 2
