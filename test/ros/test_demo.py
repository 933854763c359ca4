"""The main job on small recordings: what is answered, how it is counted, what is written."""

import resource

import numpy as np
import pytest
import scene

from depth_pose.core import outputs
from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINTS
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.io.skeleton_read import read_people, read_skeletons
from depth_pose.ros.tools.demo import replay_live, run_demo

FRAMES = 6
PERIOD_NS = 200_000_000
LOSSLESS = {"reliable": True, "queue": 2 * FRAMES}
"""Every frame is answered, however slow the machine is."""


def write(path, frames=FRAMES, period_ns=PERIOD_NS):
    stamps = [1_000_000_000 + i * period_ns for i in range(frames)]
    with DepthWriter(path, scene.CAMERA, "optical") as writer:
        for stamp_ns, frame in zip(stamps, scene.frames(frames), strict=True):
            writer.write(stamp_ns, frame.depth)
    return stamps


def test_answers_and_times_are_counted(tmp_path, bank_path):
    stamps = write(tmp_path / "in.mcap")
    ready, progress = [], []
    result = replay_live(
        tmp_path / "in.mcap",
        tmp_path / "out.mcap",
        bank_path,
        parameters=LOSSLESS,
        on_ready=lambda: ready.append(True),
        progress=progress.append,
    )
    assert (result.frames, result.answered, result.restarts, result.damage) == (FRAMES, FRAMES, 0, ())
    followed, everybody = read_skeletons(tmp_path / "out.mcap"), list(read_people(tmp_path / "out.mcap"))
    assert [s.stamp_ns for s in followed] == [frame.stamp_ns for frame in everybody] == stamps
    assert result.occupied == sum(bool(frame.skeletons) for frame in everybody) > 0
    assert result.people == len({s.body_id for frame in everybody for s in frame.skeletons})
    assert result.wall_s >= (FRAMES - 1) * PERIOD_NS * 1e-9 - 0.05  # at its own rate
    assert (FRAMES - 1) / result.wall_s <= result.input_hz
    assert result.latency_s.shape == (FRAMES,) and np.all(result.latency_s > 0.0)
    assert ready == [True] and progress == list(range(1, FRAMES + 1))


def test_one_frame_gives_a_table_and_a_picture(tmp_path, bank_path, monkeypatch, capsys):
    stamps = write(tmp_path / "one.mcap", frames=1)
    joints = np.random.default_rng(0).uniform(size=(1, len(JOINTS), 3)).astype(np.float32)
    truth = {
        "names": np.array(JOINTS),
        "stamps_ns": np.array(stamps),
        "seen": np.ones((1, len(JOINTS)), bool),
    }
    np.savez(tmp_path / "one.npz", joints=joints, K=np.eye(3), box=np.zeros(6), **truth)
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))
    assert any(run_demo(tmp_path / "one.mcap", tmp_path / "results") == 0 for _ in range(5))
    assert (tmp_path / "results" / "one.png").read_bytes().startswith(b"\x89PNG")
    assert len(list(read_skeletons(tmp_path / "results" / "one_skeleton.mcap"))) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "1 (100.0%)" in printed
    assert "error of the answered" in printed


def test_a_full_disk_is_told_before_the_work_or_with_what_is_left(tmp_path, bank_path, monkeypatch):
    """And what was there before stays."""
    write(tmp_path / "in.mcap", frames=40, period_ns=100_000_000)
    results = tmp_path / "results"
    results.mkdir()
    (results / "in_skeleton.mcap").write_bytes(b"old")
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, unlimited[1]))
    try:
        with pytest.raises(InputError, match=r"in_skeleton\.mcap cannot be written: File too large"):
            run_demo(tmp_path / "in.mcap", results)
        assert [p.name for p in results.iterdir()] == ["in_skeleton.mcap"]
        monkeypatch.setattr(outputs, "TRIAL_BYTES", 1)  # as where it fills up later
        with pytest.raises(
            InputError, match=r"what was recorded before that is in .*in_skeleton\.partial\.mcap"
        ):
            run_demo(tmp_path / "in.mcap", results)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
    assert (results / "in_skeleton.mcap").read_bytes() == b"old"
    assert not (results / "in.png").exists()


def test_no_recording_is_refused_before_anything_starts(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.mcap"):
        run_demo(tmp_path / "nothing.mcap", tmp_path / "results")
    assert not (tmp_path / "results").exists()
