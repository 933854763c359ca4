"""Rolled sensors: turned upright and back, nothing lost at quarters, the same pose at any angle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from crowd import person, seen
from depth_pose.core.camera import Camera
from depth_pose.core.config import MountConfig, PersonalConfig, PipelineConfig, SmoothConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import HIDDEN
from depth_pose.core.mount import rotate_upright, rotation_sensor_upright
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.pipeline import PosePipeline


def points_of(frame: DepthFrame) -> np.ndarray:
    c = frame.camera
    v, u = np.nonzero(frame.depth)
    z = frame.depth[v, u].astype(np.float64)
    return np.stack([(u - c.cx) / c.fx * z, (v - c.cy) / c.fy * z, z], axis=1)


def rolled(frame: DepthFrame, roll: float) -> DepthFrame:
    """What a sensor rolled by quarters, clockwise as it looks, would have seen instead."""
    quarters = round(roll / 90) % 4
    depth = np.rot90(frame.depth, quarters).copy()
    c = frame.camera
    for _ in range(quarters):
        c = Camera(c.height, c.width, c.fy, c.fx, c.cy, c.width - 1 - c.cx)
    return DepthFrame(frame.stamp_ns, frame.frame_id, depth, c)


@pytest.mark.parametrize("roll", [90.0, 180.0, 270.0, -90.0])
def test_quarters_are_exact(roll) -> None:
    upright = seen(3, [person(3, 0.3, 3.0)])
    got = rotate_upright(rolled(upright, roll), MountConfig(roll=roll))
    np.testing.assert_array_equal(got.depth, upright.depth)
    assert (got.camera.width, got.camera.height) == (upright.camera.width, upright.camera.height)
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(got.camera, name) == pytest.approx(getattr(upright.camera, name))
    assert got.frame_id == "camera_upright"


@pytest.mark.parametrize("roll", [20.0, 130.0])
def test_points_lie_where_they_were(roll) -> None:
    """Any angle: the upright frame's points, turned back, are the sensor's to half a pixel."""
    frame = seen(0, [person(0, 0.0, 3.0)])
    got = rotate_upright(frame, MountConfig(roll=roll))
    back = points_of(got) @ rotation_sensor_upright(roll).T
    known = points_of(frame)
    sample = back[:: max(1, len(back) // 300)]
    nearest = np.sqrt(((sample[:, None] - known[None]) ** 2).sum(axis=2).min(axis=1))
    assert nearest.max() < 0.75 * 4.8 / 170


def test_no_roll_changes_nothing() -> None:
    frame = seen(0, [person(0, 0.0, 3.0)])
    assert rotate_upright(frame, MountConfig()) is frame
    assert rotate_upright(frame, MountConfig(roll=360.0)) is frame


@pytest.mark.parametrize("roll", [180.0, 90.0])
def test_poses_come_in_the_sensor_s_own_frame(bank, roll) -> None:
    config = PipelineConfig(
        mount=MountConfig(roll=roll), build=PersonalConfig(scale=1.0), smooth=SmoothConfig(enabled=False)
    )
    pipeline = PosePipeline(bank, config)
    upright = PosePipeline(bank, replace(config, mount=MountConfig()))
    turn = rotation_sensor_upright(roll)
    for k in range(3):
        frame = seen(k, [person(k, 0.2, 3.2)])
        known = upright.process_frame(frame).skeleton
        result = pipeline.process_frame(rolled(frame, roll))
        skeleton = result.skeleton
        apart = np.linalg.norm(skeleton.positions - known.positions @ turn.T, axis=1)
        assert apart.max() < 1e-3
        assert skeleton.frame_id == "camera"
        assert result.people.frame_id == "camera_upright"
        turned = quat_to_matrix(skeleton.quats_xyzw)
        np.testing.assert_allclose(turned, turn @ quat_to_matrix(known.quats_xyzw), atol=1e-2)


def test_blank_corners_are_no_background_that_was_cut_away() -> None:
    """Of a sensor rolled by 45 degrees half of the upright image is blank; holes are still holes."""
    frame = seen(3, [person(3, 0.0, 3.0)])
    depth = frame.depth.copy()
    depth[:, :20] = 0.0  # an eighth of it returns nothing
    config = MountConfig(roll=45.0)
    turned = rotate_upright(replace(frame, depth=depth), config)
    assert turned.filled == pytest.approx(np.mean(rotate_upright(frame, config).depth > 0), abs=0.01)
    assert (turned.depth == 0).mean() > 0.5
    segmentation = LearnedSegmenter(PipelineConfig().segment).segment(turned)
    assert (segmentation.labels == HIDDEN).mean() > 0.5
