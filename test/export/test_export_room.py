"""Exports of skeletons in a room's frame: z is up and the floor at z = 0, and they stay there."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from test_export import CAMERA_HEIGHT, START_NS, STEP_NS, bvh_heads, skeleton_of

from depth_pose.cli.app import app
from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS
from depth_pose.export import export_skeletons
from depth_pose.io.mcap_write import SkeletonWriter
from depth_pose.rooms.merge import place
from depth_pose.rooms.rig import ROOM_FRAME

FRAMES = 12
ANGLE = np.radians(30.0)
T_ROOM_CAMERA = np.array(
    [
        [np.sin(ANGLE), 0.0, np.cos(ANGLE), -0.4],
        [-np.cos(ANGLE), 0.0, np.sin(ANGLE), 1.2],
        [0.0, -1.0, 0.0, CAMERA_HEIGHT],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""A level camera in the room, turned to the left by `ANGLE`."""


@pytest.fixture
def room(tmp_path):
    """Somebody in a room, as `depth-pose run --rig` writes them."""
    with SkeletonWriter(tmp_path / "room.mcap") as writer:
        for i in range(FRAMES):
            person = place(skeleton_of(i, "person_1"), T_ROOM_CAMERA, ROOM_FRAME)
            writer.write_people([person], person.stamp_ns, ROOM_FRAME)
    return tmp_path / "room.mcap"


def expected():
    """Joints (T, 19, 3) in the room, metres."""
    at = np.array([skeleton_of(i).positions for i in range(FRAMES)])
    return at @ T_ROOM_CAMERA[:3, :3].T + T_ROOM_CAMERA[:3, 3]


def with_y_up(positions):
    return np.stack([positions[..., 0], positions[..., 2], -positions[..., 1]], axis=-1)


def check_upright(heights):
    """Check heights (T, 19) in metres: the head is above the pelvis, the lower foot on the floor."""
    assert (heights[:, JOINT_INDEX["head"]] > heights[:, JOINT_INDEX["pelvis"]] + 0.4).all()
    feet = np.minimum(heights[:, JOINT_INDEX["left_foot"]], heights[:, JOINT_INDEX["right_foot"]])
    assert (np.abs(feet) < 0.15).all()


@pytest.mark.parametrize("world", ["camera", "floor"])
def test_npz_has_the_room_as_it_is(room, tmp_path, world):
    result = export_skeletons(room, tmp_path / "room.npz", world=world)
    assert (result.frame_id, result.floor) == (ROOM_FRAME, None)
    with np.load(tmp_path / "room.npz") as data:
        assert str(data["frame_id"]) == "room"
        assert "T_world_camera" not in data
        np.testing.assert_allclose(data["positions"][:, 0], expected(), atol=1e-12)
        check_upright(data["positions"][:, 0, :, 2])


def test_csv_has_the_room_as_it_is_and_names_it(room, tmp_path):
    export_skeletons(room, tmp_path / "room.csv")
    with (tmp_path / "room.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert {row["frame_id"] for row in rows} == {"room"}
    positions = np.array([[float(row[axis]) for axis in "xyz"] for row in rows]).reshape(FRAMES, 19, 3)
    np.testing.assert_allclose(positions, expected(), atol=1e-12)


def test_bvh_is_upright_on_the_floor(room, tmp_path):
    result = export_skeletons(room, tmp_path / "room.bvh", world="floor")
    assert result.floor is None
    names, heads = bvh_heads(tmp_path / "room.bvh", FRAMES)
    positions = heads[:, [names.index(joint) for joint in JOINTS]]
    assert np.linalg.norm(positions - with_y_up(expected()), axis=-1).max() < 0.01
    check_upright(positions[..., 1])


def test_trc_is_upright_in_millimetres(room, tmp_path):
    export_skeletons(room, tmp_path / "room.trc")
    lines = (tmp_path / "room.trc").read_text().splitlines()
    assert lines[2].split("\t")[4] == "mm"
    positions = np.array([line.split("\t")[2:] for line in lines[6:]], float).reshape(FRAMES, 19, 3)
    np.testing.assert_allclose(positions, 1e3 * with_y_up(expected()), atol=1e-5)
    check_upright(1e-3 * positions[..., 1])


def test_the_floor_is_not_sought_in_images(room, tmp_path):
    with pytest.raises(ConfigError, match="whose floor is known"):
        export_skeletons(room, tmp_path / "room.npz", world="floor", recording=tmp_path / "in.mcap")


def test_the_command_names_the_frame(room, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    app(["export", str(room), "-o", str(tmp_path / "room.bvh"), "--world", "floor"], standalone_mode=False)
    said = capsys.readouterr().out
    assert "in the room's frame" in said
    assert "below the sensor" not in said


def test_times_are_kept(room, tmp_path):
    export_skeletons(room, tmp_path / "room.npz")
    with np.load(tmp_path / "room.npz") as data:
        np.testing.assert_array_equal(data["stamps_ns"], START_NS + STEP_NS * np.arange(FRAMES))
