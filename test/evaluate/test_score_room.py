"""Scores of skeletons in a room's frame, at other times than the truth's, and of frames that do not fit."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from command import Done, caller
from depth_pose.core.skeleton import JOINT_NODES, JOINTS, rest_nodes
from depth_pose.io.mcap_write import SkeletonWriter
from depth_pose.rooms.recorded import read_recorded
from depth_pose.rooms.rig import ROOM_FRAME
from skeletons import make_skeleton

SECONDS = 4.0
START_NS = 10**18
REST = rest_nodes()[JOINT_NODES][:, [2, 0, 1]] * 1.75
"""A standing adult (19, 3) in the room's frame."""


def joints_at(seconds: np.ndarray, person: int) -> np.ndarray:
    """Joints (T, 19, 3) of one of two people who walk a circle at 1.3 m/s and swing their wrists."""
    seconds = np.atleast_1d(seconds)
    angle = 1.3 * seconds + np.pi * person
    at = np.repeat(REST[None], len(seconds), axis=0)
    at[..., 0] += np.cos(angle)[:, None]
    at[..., 1] += np.sin(angle)[:, None]
    at[:, JOINTS.index("left_wrist"), 0] += 0.3 * np.sin(2 * np.pi * seconds)
    return at


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    """Truth as `simulate --room --cameras` writes it, 15 a second."""
    times = np.arange(0.0, SECONDS, 1 / 15)
    joints = np.stack([joints_at(times, p) for p in (0, 1)], axis=1)
    np.savez(
        tmp_path / "room.npz",
        joints=joints,
        names=np.array(JOINTS),
        stamps_ns=START_NS + np.rint(times * 1e9).astype(np.int64),
        seen=np.ones(joints.shape[:-1], bool),
        visible=np.ones(joints.shape[:2]),
        T_camera_world=np.tile(np.eye(4), (2, 1, 1)),
    )
    return tmp_path / "room.npz"


def write(path: Path, frame_id: str = ROOM_FRAME, rate_hz: float = 30.0, phase_s: float = 0.012) -> Path:
    """Write what a perfect fusion answers at a faster camera's frames."""
    with SkeletonWriter(path) as writer:
        for seconds in np.arange(phase_s - 1 / rate_hz, SECONDS + 0.05, 1 / rate_hz):
            stamp = START_NS + round(seconds * 1e9)
            people = [
                make_skeleton(joints_at(seconds, p)[0], stamp_ns=stamp, frame_id=frame_id, body_id=f"p_{p}")
                for p in (0, 1)
            ]
            writer.write_people(people, stamp, frame_id)
            writer.write(people[0])
    return path


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    return caller(monkeypatch, capsys)


def test_answers_between_the_true_times_are_scored(
    truth: Path, tmp_path: Path, call: Callable[..., Done]
) -> None:
    done = call("eval", truth, write(tmp_path / "answers.mcap"), "--json")
    assert done.returncode == 0, done.stderr
    total = json.loads(done.stdout)["total"]
    assert (total["asked"], total["found"], total["false"], total["switches"]) == (120, 120, 0, 0)
    assert (total["idf1"], total["pck10"]) == (1.0, 1.0)
    assert total["mean_error_mm"] < 1.0, "the nearest answer would be 12 mm off"


def test_a_gap_has_no_answers(tmp_path: Path) -> None:
    people = read_recorded(write(tmp_path / "slow.mcap", rate_hz=2.0, phase_s=0.0))
    assert people.is_room
    assert people.at(START_NS + 200_000_000) is None
    assert len(people.at(START_NS + 100_000_000) or ()) == 2
    assert people.at(START_NS - 800_000_000) is None


def test_who_is_in_one_answer_only_is_taken_as_they_are(tmp_path: Path) -> None:
    with SkeletonWriter(tmp_path / "two.mcap") as writer:
        for i, ids in enumerate(["a", "ab"]):
            skeletons = [make_skeleton(REST + i, stamp_ns=i * 40_000_000, body_id=b) for b in ids]
            writer.write_people(skeletons, i * 40_000_000, ROOM_FRAME)
    people = read_recorded(tmp_path / "two.mcap")
    early, late = people.at(10_000_000) or (), people.at(30_000_000) or ()
    assert [s.body_id for s in early] == ["a"]
    assert [s.body_id for s in late] == ["a", "b"]
    np.testing.assert_allclose(early[0].positions, REST + 0.25)
    np.testing.assert_allclose(late[0].positions, REST + 0.75)
    np.testing.assert_allclose(late[1].positions, REST + 1.0)
    assert {s.stamp_ns for s in late} == {30_000_000}


def test_frames_that_do_not_fit_are_refused(truth: Path, tmp_path: Path, call: Callable[..., Done]) -> None:
    of_camera = write(tmp_path / "camera.mcap", "camera0_depth_optical_frame")
    done = call("eval", truth, of_camera)
    assert done.returncode == 1
    assert "room.npz is in a room's frame" in done.stderr
    assert "'camera0_depth_optical_frame'" in done.stderr
    of_room = write(tmp_path / "room.mcap")
    with np.load(truth) as fields:
        known = {name: fields[name] for name in fields if name != "T_camera_world"}
    np.savez(tmp_path / "people.npz", **known)
    alone = {"joints": known["joints"][:, 0], "seen": known["seen"][:, 0]}
    np.savez(tmp_path / "one.npz", names=known["names"], stamps_ns=known["stamps_ns"], **alone)
    for camera_truth in ("people.npz", "one.npz"):
        done = call("eval", tmp_path / camera_truth, of_room)
        assert done.returncode == 1
        assert "room.mcap is in a room's frame, and the truth in a camera's" in done.stderr
