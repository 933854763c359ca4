"""The benchmark of stages reaches into the pipeline, where no other test would notice that it fails."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import simulate

STAGES = Path(__file__).parents[1] / "benchmarks" / "stages.py"


def test_every_stage_is_timed(bank_path, tmp_path):
    simulate(tmp_path / "clip.mcap", Person().body(), load_motion("stand_casual", 25.0, 0.6))
    command = [sys.executable, STAGES, tmp_path / "clip.mcap", "--bank", bank_path]
    environment = os.environ | {"PYTHONPATH": str(STAGES.parents[1] / "src")}
    out = subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout
    rows = [[c.strip() for c in line.strip("| ").split("|")] for line in out.splitlines()[2:]]
    assert [row[:3] for row in rows] == [["176x144", "1.0", "articulated"], ["176x144", "1.0", "cpd"]]
    for row in rows:
        finder, rest, matcher, refine, recovery, total = (float(c.strip("*").split(" ")[0]) for c in row[3:9])
        assert min(finder, rest, matcher, refine, recovery) > 0.0
        assert 0.5 * total < finder + rest + matcher + refine + recovery < 2.0 * total
