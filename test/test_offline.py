"""Offline runs of the whole method over a small simulated recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from depth_pose.bank import Bank, build_bank
from depth_pose.bank.build import BuildConfig
from depth_pose.body.procedural import make_body
from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.io.markers import MARKERS_TOPIC
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.io.skeleton_read import read_skeletons
from depth_pose.motion.procedural.generator import make_poses
from depth_pose.offline import process_recording
from depth_pose.passes import SecondPass
from depth_pose.pipeline import PosePipeline
from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import simulate

FRAMES = 4


@pytest.fixture(scope="module")
def bank() -> Bank:
    poses = make_poses(60, seed=1)
    return build_bank(make_body(), poses.rotations, BuildConfig(dimensions=16), {}, workers=0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few frames of a person, then two in which there is nothing at all."""
    folder = tmp_path_factory.mktemp("offline")
    simulate(folder / "person.mcap", Person().body(), load_motion("stand_casual", 25.0, FRAMES / 25.0))
    reader = list(DepthReader(folder / "person.mcap"))
    with DepthWriter(folder / "in.mcap", reader[0].camera, "optical") as writer:
        for frame in reader:
            writer.write_frame(frame)
        for late in (1, 2):
            empty = np.zeros_like(reader[0].depth)
            writer.write(reader[-1].stamp_ns + late * 40_000_000, empty)
    return folder / "in.mcap"


@pytest.mark.slow
def test_every_frame_is_answered_the_same_each_time(tmp_path: Path, bank: Bank, recording: Path) -> None:
    pipeline = PosePipeline(bank)
    told: list[int] = []
    summary = process_recording(DepthReader(recording), tmp_path / "a.mcap", pipeline, told.append)
    assert (summary.frames, summary.dropped, summary.warnings) == (FRAMES + 2, 0, ())
    assert summary.answered + summary.empty == FRAMES + 2
    assert summary.answered >= FRAMES
    assert summary.median_ms > 0
    assert told == list(range(1, FRAMES + 3))
    skeletons = list(read_skeletons(tmp_path / "a.mcap"))
    assert [s.stamp_ns for s in skeletons] == [f.stamp_ns for f in DepthReader(recording)]
    assert all(s.positions.shape == (19, 3) for s in skeletons[:FRAMES])
    process_recording(DepthReader(recording), tmp_path / "b.mcap", PosePipeline(bank))
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    process_recording(DepthReader(recording), tmp_path / "c.mcap", PosePipeline(bank), is_ahead=True)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "c.mcap").read_bytes()
    process_recording(DepthReader(recording), tmp_path / "m.mcap", PosePipeline(bank), markers=True)
    drawn = list(read_ros2_messages(tmp_path / "m.mcap", topics=[MARKERS_TOPIC]))
    assert [m.log_time_ns for m in drawn] == [s.stamp_ns for s in skeletons]
    assert [len(m.ros_msg.markers) > 1 for m in drawn[:FRAMES]] == [not s.is_lost for s in skeletons[:FRAMES]]


@pytest.mark.slow
def test_two_passes_answer_every_frame_once(tmp_path: Path, bank: Bank, recording: Path) -> None:
    told: list[int] = []
    for name in ("a.mcap", "b.mcap"):
        pipeline = PosePipeline(bank)
        second = SecondPass(pipeline)
        reader = DepthReader(recording)
        summary = process_recording(reader, tmp_path / name, pipeline, told.append, second=second)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert told == 2 * list(range(1, 2 * (FRAMES + 2) + 1))
    assert summary.answered >= FRAMES
    assert summary.gain is not None and summary.gain.skeletons >= FRAMES
    process_recording(DepthReader(recording), tmp_path / "once.mcap", PosePipeline(bank))
    once, twice = (list(read_skeletons(tmp_path / name)) for name in ("once.mcap", "a.mcap"))
    assert [(s.stamp_ns, s.body_id) for s in twice[:FRAMES]] == [
        (s.stamp_ns, s.body_id) for s in once[:FRAMES]
    ]
    pairs = list(zip(once[:FRAMES], twice[:FRAMES], strict=True))
    assert max(np.linalg.norm(a.positions - b.positions, axis=1).mean() for a, b in pairs) < 0.1
    assert any((a.positions != b.positions).any() for a, b in pairs)


def test_a_recording_whose_stamps_are_none_fails(tmp_path: Path, bank: Bank, recording: Path) -> None:
    """A clock that was never set: nothing is written, and nothing is called done."""

    class Unset(DepthReader):
        def __iter__(self) -> Iterator[DepthFrame]:
            return (replace(frame, stamp_ns=-1) for frame in super().__iter__())

    with pytest.raises(InputError, match="frames were dropped: its stamp is below 0"):
        process_recording(Unset(recording), tmp_path / "out.mcap", PosePipeline(bank))
    assert not (tmp_path / "out.mcap").exists()
