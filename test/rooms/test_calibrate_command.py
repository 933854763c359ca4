"""``depth-pose calibrate``: rig file, picture and words, and what it refuses."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from static_transforms import transforms_message
from strollers import Stroller, place_camera, record_camera

from command import Done, caller
from crowd import CAMERA, STEP_NS, person, seen
from depth_pose.evaluate.room_picture import save_room_picture
from depth_pose.io import schemas
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.rooms.calibration import RoomCalibration
from depth_pose.rooms.rigfile import load_rig, save_rig

APART_M = 0.5


@pytest.fixture
def call(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], bank_path: Path
) -> Callable[..., Done]:
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))
    return caller(monkeypatch, capsys)


def record(path: Path, x: float, seconds: float, transform: bool = False) -> Path:
    """Record two people who walk to and fro before a wall, by a camera at a place beside the first one."""
    with DepthWriter(path, CAMERA, f"{path.stem}_optical") as writer:
        if transform:
            pose = (APART_M, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
            message = transforms_message("left_optical", "right_optical", pose)
            writer.write_message("/tf_static", schemas.TRANSFORMS, 0, message)
        for t in range(0, round(seconds * 1e9 / STEP_NS), 4):
            swing = np.sin(0.05 * t)
            people = [person(t, -0.2 + 0.6 * swing - x, 2.6), person(t, 0.5 - 0.4 * swing - x, 3.4, 1.0)]
            writer.write(t * STEP_NS, seen(t, people).depth)
    return path


def test_known_transforms_of_two_recordings(tmp_path: Path, call: Callable[..., Done]) -> None:
    first = record(tmp_path / "left.mcap", 0.0, 5.6)
    second = record(tmp_path / "right.mcap", APART_M, 5.6, transform=True)
    done = call("calibrate", first, second, "-o", tmp_path / "rig.yaml", "--workers", "0")
    assert done.returncode == 0, done.stderr
    assert "from /tf_static" in done.stdout
    assert "degrees; clock" in done.stdout
    rig = load_rig(tmp_path / "rig.yaml")
    assert [camera.name for camera in rig.cameras] == ["left", "right"]
    assert rig.frame_ids == ("left_optical", "right_optical")
    assert rig.clock_offsets == pytest.approx((0.0, 0.0), abs=0.01)
    assert np.linalg.norm(rig.cameras[1].position - rig.cameras[0].position) == pytest.approx(APART_M)
    assert (tmp_path / "rig.png").read_bytes().startswith(b"\x89PNG")


def test_refusals(tmp_path: Path, call: Callable[..., Done]) -> None:
    first, second = (record(tmp_path / f"{name}.mcap", 0.0, 0.4) for name in ("left", "right"))
    for arguments, code, words in (
        ((first, second, "-o", tmp_path / "rig.yaml"), 1, "s in common"),
        ((first, "-o", tmp_path / "rig.yaml"), 2, "at least two cameras"),
        ((first, second, "-o", tmp_path / "rig.png"), 2, "ends in .yaml"),
        (
            (first, second, "-o", tmp_path / "rig.yaml", "--picture", "a.xyz"),
            2,
            "pictures are of the formats",
        ),
        ((first, tmp_path / "none.mcap", "-o", tmp_path / "rig.yaml"), 1, "none.mcap"),
    ):
        done = call("calibrate", *arguments, "--workers", "0")
        assert done.returncode == code
        assert words in done.stderr
        assert not (tmp_path / "rig.yaml").exists()


def test_a_rig_file_and_its_picture(tmp_path: Path) -> None:
    """Cameras found from people are written and read back; the clock is corrected by the file."""
    places = [place_camera(0.0, 0.0, 1.5, (3.0, 0.0, 1.0)), place_camera(2.5, -2.8, 1.2, (3.0, 0.5, 1.0))]
    walker = Stroller.strolling(1, 12.0)
    records = [
        record_camera(name, T, [walker], 12.0, offset=offset, seed=n)
        for n, (name, T, offset) in enumerate(zip("ab", places, (0.0, 0.1), strict=True))
    ]
    calibration = RoomCalibration(records).solve()
    rig = calibration.rig
    save_rig(tmp_path / "rig.yaml", rig.cameras, rig.topics, rig.up, rig.clock_offsets, rig.frame_ids)
    again = load_rig(tmp_path / "rig.yaml")
    assert again.topics == rig.topics
    assert again.clock_offsets == pytest.approx((0.0, 0.1), abs=0.01)
    for camera, before in zip(again.cameras, rig.cameras, strict=True):
        assert np.allclose(camera.T_camera_world, before.T_camera_world)
    save_room_picture(calibration, tmp_path / "room.svg")
    drawn = (tmp_path / "room.svg").read_text()
    assert "<svg" in drawn
