"""A gate on accuracy that needs nothing but the set-up: a simulated clip of a build that the bank lacks."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from depth_pose.bank import Bank, default_bank_path
from depth_pose.evaluate.score import Score, score
from depth_pose.io.mcap_read import DepthReader
from depth_pose.offline import process_recording
from depth_pose.pipeline import PosePipeline
from depth_pose.sim.config import Person, Placement, Room
from depth_pose.sim.motion import load_motion
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.simulate import Stage, simulate

SEED, SECONDS = 1, 0.8
BUILD = Person(stature=1.58, girth=1.2, leg_length=0.95, arm_length=1.05, shoulder_width=0.95, head_size=1.05)
"""Small and heavy, with long arms: no exemplar is built so."""

MEASURED_MM = 28.2
"""Mean joint error of this clip on 2026-11-23, with the default bank and settings."""

SLACK = 1.3
"""The error may be so many times as large before the test fails."""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Score:
    """Score of 20 frames, 176 x 144, time of flight."""
    folder: Path = tmp_path_factory.mktemp("foreign")
    stage = Stage(SENSORS["tof"], Placement(), Room(floor=True))
    clip = load_motion("play", stage.sensor.fps, SECONDS, SEED)
    simulate(folder / "clip.mcap", BUILD.body(), clip, stage, SEED)
    pipeline = PosePipeline(Bank.load(default_bank_path()))
    process_recording(DepthReader(folder / "clip.mcap"), folder / "answers.mcap", pipeline)
    return score(folder / "clip.npz", folder / "answers.mcap")


def test_every_frame_is_answered(result: Score) -> None:
    assert result.frames == math.ceil(SECONDS * SENSORS["tof"].fps)
    assert result.coverage == 1.0


def test_a_foreign_build_is_found_as_accurately_as_it_was(result: Score) -> None:
    assert result.mean_error_mm < SLACK * MEASURED_MM
    assert result.pck10 > 0.9
