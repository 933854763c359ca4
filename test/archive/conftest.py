"""A small archive: clips of a few frames, and their skeletons made one after the other."""

from __future__ import annotations

import pytest
from small_archive import CLIPS, FRAMES

from depth_pose.archive.jobs import Setting
from depth_pose.core.config import PipelineConfig
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.offline import process_recording
from depth_pose.pipeline import PosePipeline
from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import simulate


@pytest.fixture(scope="session")
def clips(tmp_path_factory):
    """A folder of recordings: each a part of one movement, some frames of it left out."""
    folder = tmp_path_factory.mktemp("archive")
    whole = tmp_path_factory.mktemp("whole") / "person.mcap"
    count = FRAMES + CLIPS - 1
    simulate(whole, Person().body(), load_motion("stand_casual", 25.0, count / 25.0))
    frames = list(DepthReader(whole))
    for k in range(CLIPS):
        with DepthWriter(folder / f"clip_{k}.mcap", frames[0].camera, "optical") as writer:
            for frame in frames[k : k + FRAMES]:
                writer.write(frame.stamp_ns, frame.depth)
    return folder


@pytest.fixture(scope="session")
def setting(bank, bank_path):
    return Setting(str(bank_path), bank.bank_id, PipelineConfig())


@pytest.fixture(scope="session")
def alone(clips, bank, tmp_path_factory):
    """The skeletons of each clip as ``depth-pose run`` makes them of one file, by a new pipeline each."""
    folder = tmp_path_factory.mktemp("alone")
    for clip in sorted(clips.glob("*.mcap")):
        process_recording(DepthReader(clip), folder / clip.name, PosePipeline(bank))
    return folder
