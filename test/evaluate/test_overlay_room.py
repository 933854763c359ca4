"""Skeletons and truth of a room drawn into the images of its cameras."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from command import Done, caller
from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import JOINTS
from depth_pose.evaluate.panels import collect_panels
from depth_pose.rooms.placed_camera import PlacedCamera
from room_scene import CAMERAS, OFFSET_S, START_NS, people_at, write_depth, write_rig, write_room


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """The second camera's recording, the room's skeletons, the rig and the truth, 15 a second."""
    write_depth(tmp_path / "in_1.mcap", 1)
    write_room(tmp_path / "room.mcap")
    write_rig(tmp_path / "rig.yaml")
    times = np.arange(0.0, 1.1, 1 / 15)
    joints = np.array([people_at(t) for t in times])
    np.savez(
        tmp_path / "room.npz",
        joints=joints,
        names=np.array(JOINTS),
        stamps_ns=START_NS + np.rint(times * 1e9).astype(np.int64),
        seen=np.ones(joints.shape[:-1], bool),
        visible=np.ones(joints.shape[:2]),
        T_camera_world=np.tile(np.eye(4), (2, 1, 1)),
    )
    return tmp_path


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    return caller(monkeypatch, capsys)


def test_skeletons_lie_on_the_truth(room: Path) -> None:
    camera = PlacedCamera(CAMERAS[1], OFFSET_S)
    panels = collect_panels(room / "in_1.mcap", room / "room.mcap", 4, room / "room.npz", camera=camera)
    assert len(panels) == 4
    for panel in panels:
        assert panel.skeletons
        drawn = np.stack([s.positions for s in panel.skeletons])
        np.testing.assert_allclose(drawn, panel.truth, atol=1e-6)


def test_who_is_outside_the_image_is_not_drawn(room: Path) -> None:
    T = CAMERAS[1].T_camera_world.copy()
    T[0, 3] += 2.2  # seen farther to the right; the person on the right leaves the image
    camera = PlacedCamera(type(CAMERAS[1])("camera1", CAMERAS[1].camera, T), OFFSET_S)
    panels = collect_panels(room / "in_1.mcap", room / "room.mcap", 3, room / "room.npz", camera=camera)
    assert {len(panel.skeletons or ()) for panel in panels} == {1}
    assert {len(panel.truth) for panel in panels} == {1}


@pytest.mark.parametrize("name", ["out.png", "out.gif"])
def test_the_command_draws_what_a_camera_sees(room: Path, call: Callable[..., Done], name: str) -> None:
    inputs, output = (room / "in_1.mcap", room / "room.mcap", "-o", room / name), room / name
    refused = call("overlay", *inputs)
    assert refused.returncode == 2
    assert "are in a room's frame: give the rig file of its cameras, --rig" in refused.stderr
    assert not output.exists()
    done = call("overlay", *inputs, "--rig", room / "rig.yaml", "--frames", "1")
    assert done.returncode == 0, done.stderr
    assert "as camera1 sees it" in done.stdout
    assert output.exists()
    other = call("overlay", *inputs, "--rig", room / "rig.yaml", "--camera", "0")
    assert "the image of camera0 is 128 x 96" in other.stderr
    alone = call("overlay", *inputs, "--camera", "camera1")
    assert "give its file with --rig" in alone.stderr


def test_a_truth_of_the_room_needs_the_rig(room: Path) -> None:
    with pytest.raises(ConfigError, match="--rig"):
        collect_panels(room / "in_1.mcap", room / "room.mcap", 2, room / "room.npz")


def test_outputs_are_no_inputs(room: Path, call: Callable[..., Done]) -> None:
    inputs = (room / "in_1.mcap", room / "room.mcap")
    before = (room / "rig.yaml").read_bytes()
    call("overlay", *inputs, "-o", room / "rig.yaml", "--rig", room / "rig.yaml")
    assert (room / "rig.yaml").read_bytes() == before
