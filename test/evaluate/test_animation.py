"""Pictures that move: how many, how long, and that the skeleton is where it was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, rest_nodes
from depth_pose.evaluate.animation import draw_frames, save_animation
from depth_pose.io.mcap_write import DepthWriter, SkeletonWriter
from skeletons import make_skeleton

CAMERA = Camera(176, 144, 225.0, 225.0, 87.5, 71.5)
REST = (rest_nodes()[JOINT_NODES] * 1.75) @ R_CAMERA_FACING_MODEL + [0, 0.9, 3.8]
START_NS, STEP_NS = 10**18, 40_000_000


def skeleton_at(i):
    return make_skeleton(REST + [0.01 * i, 0, 0], stamp_ns=START_NS + i * STEP_NS, body_id="body_1")


@pytest.fixture
def recordings(tmp_path):
    """Two seconds of a wall with noise, and somebody who glides past it."""
    rng = np.random.default_rng(0)
    depth, people = tmp_path / "depth.mcap", tmp_path / "people.mcap"
    with DepthWriter(depth, CAMERA, "optical") as images, SkeletonWriter(people) as skeletons:
        for i in range(50):
            wall = 4.5 + 0.01 * rng.standard_normal((144, 176))
            images.write(START_NS + i * STEP_NS, wall.astype(np.float32))
            skeletons.write_people([skeleton_at(i)], START_NS + i * STEP_NS, "optical")
    return depth, people


def difference(a, b):
    return np.abs(np.asarray(a, int) - np.asarray(b, int)).sum(axis=2)


def test_it_moves_in_the_recordings_time(recordings, tmp_path):
    count = save_animation(*recordings, tmp_path / "out.gif", seconds=1.0, rate_hz=5.0, width=352)
    with Image.open(tmp_path / "out.gif") as gif:
        assert (gif.n_frames, gif.size, gif.info["duration"], gif.info["loop"]) == (count, (352, 288), 200, 0)
        assert count == 6
        first = gif.convert("RGB")
        gif.seek(5)
        last = gif.convert("RGB")
    moved = difference(first, last) > 60
    v, u = np.nonzero(moved)
    for i in (0, 25):  # what changed is where the person was, and where they are
        at = 2 * (CAMERA.project(skeleton_at(i).positions) + 0.5)
        x, y = at[JOINT_INDEX["left_wrist"]]
        assert np.hypot(u - x, v - y).min() < 6
    outside = (u < 40) | (u > 312)
    assert not outside.any(), "noise of the wall is not drawn"


def test_frames_without_an_answer_are_drawn_bare(recordings, tmp_path):
    depth, _ = recordings
    empty = tmp_path / "empty.mcap"
    with SkeletonWriter(empty) as writer:
        writer.write_people([replace(skeleton_at(0), body_id="x")], START_NS, "optical")
    save_animation(depth, empty, tmp_path / "out.gif", seconds=0.5, rate_hz=10.0, width=352)
    with Image.open(tmp_path / "out.gif") as gif:
        first = gif.convert("RGB")
        gif.seek(1)  # all that show nobody are the same, and one
        assert (difference(first, gif.convert("RGB")) > 60).any()


def test_images_may_change_their_size():
    """As those made of point clouds do: each picture is as large as the first."""
    small = CAMERA._replace(width=88, height=100)
    frames = [DepthFrame(START_NS, "optical", np.full((144, 176), 2.0, np.float32), CAMERA)]
    frames += [DepthFrame(START_NS + STEP_NS, "optical", np.full((100, 88), 3.0, np.float32), small)]
    pictures = [np.asarray(p) for p in draw_frames(frames, {}, 200)]
    assert [p.shape for p in pictures] == [(164, 200, 3)] * 2
    assert (pictures[1][:, :20] == pictures[1][0, 0]).all()  # a taller one has borders beside it
