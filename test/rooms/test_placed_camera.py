"""Skeletons of a room in the frames of one camera, and which camera of a rig made a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.io.mcap_read import DepthReader
from depth_pose.rooms.placed_camera import PlacedCamera, answers_in_frames, choose_camera
from depth_pose.rooms.recorded import read_recorded
from depth_pose.rooms.rig import RigCamera
from depth_pose.rooms.rigfile import Rig, load_rig
from room_scene import CAMERAS, OFFSET_S, START_NS, people_at, write_depth, write_rig, write_room


@pytest.mark.parametrize("number", [0, 1])
def test_skeletons_are_where_the_camera_sees_them(tmp_path: Path, number: int) -> None:
    """At the camera's own times, by its clock, in its optical frame; interpolated exactly, as all walk."""
    placed = choose_camera(
        load_rig(write_rig(tmp_path / "rig.yaml")), Path("rig"), Path(f"hall_{number}.mcap")
    )
    people = read_recorded(write_room(tmp_path / "room.mcap"))
    answer = answers_in_frames(people, placed)
    frames = list(DepthReader(write_depth(tmp_path / "in.mcap", number)))
    assert len(frames) == 17
    for frame in frames:
        skeletons = answer(frame)
        assert skeletons is not None
        seconds = (frame.stamp_ns - START_NS) * 1e-9 - number * OFFSET_S
        for skeleton, joints in zip(skeletons, people_at(seconds), strict=True):
            np.testing.assert_allclose(placed.to_camera(joints), skeleton.positions, atol=1e-6)
            assert (skeleton.stamp_ns, skeleton.frame_id) == (frame.stamp_ns, f"camera{number}_optical")
            assert skeleton["head"].position[1] < skeleton["pelvis"].position[1], "y is down"
            assert 1.5 < skeleton["pelvis"].position[2] < 4.5, "in front of the camera"


def test_skeletons_of_a_camera_stay_as_they_are(tmp_path: Path) -> None:
    people = read_recorded(write_room(tmp_path / "room.mcap"))
    of_camera = type(people)(people.path, "optical", people.answers)
    frame = next(iter(DepthReader(write_depth(tmp_path / "in.mcap", 0))))
    assert answers_in_frames(of_camera, None)(frame) == people.answers[START_NS]


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    people = read_recorded(write_room(tmp_path / "room.mcap"))
    with pytest.raises(ConfigError, match=r"room\.mcap are in a room's frame: .* --rig"):
        answers_in_frames(people, None)
    frame = next(iter(DepthReader(write_depth(tmp_path / "in.mcap", 0))))
    with pytest.raises(InputError, match="the image of camera1 is 160 x 120"):
        answers_in_frames(people, PlacedCamera(CAMERAS[1]))(frame)


RIG = Rig(
    tuple(
        RigCamera(name, Camera(160, 120, 140.0, 140.0, 79.5, 59.5), np.eye(4))
        for name in ("left", "door_07", "1")
    ),
    clock_offsets=(0.0, 0.2, 0.3),
)


@pytest.mark.parametrize(
    ("recording", "name", "chosen"),
    [
        ("left.mcap", None, "left"),
        ("other/hall_7.mcap", None, "door_07"),
        ("hall_01.mcap", None, "1"),
        ("left.mcap", "door_07", "door_07"),
        ("left.mcap", "2", "1"),
        ("left.mcap", "1", "1"),
    ],
)
def test_the_camera_of_a_recording(recording: str, name: str | None, chosen: str) -> None:
    placed = choose_camera(RIG, Path("rig.yaml"), Path(recording), name)
    assert placed.camera.name == chosen
    assert placed.clock_offset_s == RIG.clock_offsets[[c.name for c in RIG.cameras].index(chosen)]


def test_a_camera_that_is_not_known() -> None:
    with pytest.raises(
        ConfigError, match=r"rig\.yaml has no camera 'right'; its cameras are left, door_07, 1"
    ):
        choose_camera(RIG, Path("rig.yaml"), Path("left.mcap"), "right")
    with pytest.raises(ConfigError, match=r"nothing tells which camera .* --camera; its cameras are left"):
        choose_camera(RIG, Path("rig.yaml"), Path("hall.mcap"))
    assert choose_camera(Rig(RIG.cameras[:1]), Path("rig.yaml"), Path("hall.mcap")).camera.name == "left"
