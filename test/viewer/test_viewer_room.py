"""A room in the viewer: its skeletons alone, or with one camera's depth; all stands in the room's frame."""

from __future__ import annotations

import numpy as np
import pytest
from viewer_scene import wait_for

from depth_pose.cli.view import recorded_source
from depth_pose.core.errors import ConfigError
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.skeleton import BONES
from depth_pose.io.schemas import PEOPLE_TOPIC
from room_scene import CAMERAS, OFFSET_S, START_NS, STEP_NS, people_at, write_depth, write_rig, write_room


@pytest.fixture
def room(tmp_path):
    """The room's skeletons, the rig, and the second camera's recording."""
    write_room(tmp_path / "room.mcap")
    write_rig(tmp_path / "rig.yaml")
    write_depth(tmp_path / "in_1.mcap", 1)
    return tmp_path


def source_of(recording, skeletons=None, rig=None, camera=None):
    return recorded_source(recording, skeletons, None, None, PEOPLE_TOPIC, 4000, rig, camera)


def node(viewer, name):
    return viewer.server.scene.get_handle_by_name(name)


def pose(viewer, name):
    """Where a node at the top of the scene is, (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = quat_to_matrix(np.roll(np.array(node(viewer, name).wxyz, float), -1))
    T[:3, 3] = node(viewer, name).position
    return T


def check_people(viewer, joints):
    """Check that people (P, 19, 3) are drawn where they are in the room."""
    T = pose(viewer, "/sensor")
    for i, person in enumerate(joints):
        bones = np.asarray(node(viewer, f"/sensor/people/person_{i + 1}/bones").points)
        np.testing.assert_allclose(bones @ T[:3, :3].T + T[:3, 3], person[np.array(BONES)], atol=1e-4)
        name = T[:3, :3] @ node(viewer, f"/sensor/people/person_{i + 1}/name").position + T[:3, 3]
        assert name[2] > person[:, 2].max(), "names stand above the heads"


def show(start_viewer, source, index):
    viewer = start_viewer(source)
    source.playback.playing = False
    source.playback.seek(index)
    wait_for(lambda: viewer.frame is source.frame(index))
    drawn = viewer.drawn
    viewer.set_visible("names", True)  # draws it again, or it is being drawn
    wait_for(lambda: viewer.drawn > drawn)
    return viewer


def test_skeletons_alone(room, start_viewer):
    source = source_of(room / "room.mcap")
    viewer = show(start_viewer, source, 20)
    assert (source.error, len(source.playback)) == ("", 26)
    check_people(viewer, people_at(20 * STEP_NS * 1e-9))
    assert node(viewer, "/floor").visible
    assert node(viewer, "/floor").position[2] == 0.0
    assert node(viewer, "/sensor/camera") is None
    assert node(viewer, "/cameras/0") is None


def test_skeletons_and_the_rig(room, start_viewer):
    viewer = show(start_viewer, source_of(room / "room.mcap", rig=room / "rig.yaml"), 5)
    check_people(viewer, people_at(5 * STEP_NS * 1e-9))
    for number, camera in enumerate(CAMERAS):
        np.testing.assert_allclose(pose(viewer, f"/cameras/{number}"), camera.T_room_camera, atol=1e-6)
    np.testing.assert_allclose(pose(viewer, "/sensor"), CAMERAS[0].T_room_camera, atol=1e-6)
    viewer.set_visible("camera", False)
    wait_for(lambda: not node(viewer, "/cameras/1").visible)


def test_one_cameras_depth_in_the_room(room, start_viewer):
    source = source_of(room / "in_1.mcap", room / "room.mcap", room / "rig.yaml")
    viewer = show(start_viewer, source, 7)
    assert source.error == ""
    seconds = (source.frame(7).stamp_ns - START_NS) * 1e-9 - OFFSET_S
    check_people(viewer, people_at(seconds))
    T = pose(viewer, "/sensor")
    np.testing.assert_allclose(T, CAMERAS[1].T_room_camera, atol=1e-6)
    points = np.asarray(node(viewer, "/sensor/points").points, np.float64) @ T[:3, :3].T + T[:3, 3]
    assert len(points) > 1000
    assert np.abs(points[:, 2]).max() < 0.01, "it sees the floor, at z = 0"
    eye = np.array(viewer.server.initial_camera.position)
    ahead = T[:2, 2] / np.linalg.norm(T[:2, 2])
    assert (eye - T[:3, 3])[:2] @ ahead == pytest.approx(-1.4), "behind the camera"


def test_the_rig_is_needed_with_depth(room):
    with pytest.raises(ConfigError, match="--rig"):
        source_of(room / "in_1.mcap", room / "room.mcap")
