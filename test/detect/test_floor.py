"""The floor is found from any height and tilt; tables, walls, ceilings and people are not the floor."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.config import MountConfig, SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.mount import up_direction
from depth_pose.core.rotations import rotation_x
from depth_pose.detect.floor import BY_PEOPLE, Floor, FloorFinder

RAYS = np.dstack(
    [
        *np.meshgrid(
            (np.arange(syn.CAMERA.width) - syn.CAMERA.cx) / syn.CAMERA.fx,
            (np.arange(syn.CAMERA.height) - syn.CAMERA.cy) / syn.CAMERA.fy,
        ),
        np.ones((syn.CAMERA.height, syn.CAMERA.width)),
    ]
)


def plane(normal, offset):
    """Depth image of the plane ``n . p = d``."""
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = offset / (RAYS @ np.asarray(normal, float))
    return np.where(depth > 0, depth, np.inf)


def frame(depth, stamp=0):
    return DepthFrame(stamp, "", np.where(depth < 7.9, depth, 0.0).astype(np.float32), syn.CAMERA)


def room(height, down_deg, table=None):
    """A floor, a wall 4 m ahead, a ceiling and maybe a table top, from a camera that looks down."""
    R = rotation_x(np.radians(down_deg))  # level to camera
    level = R.T
    down, ahead = np.array([0.0, 1.0, 0.0]) @ level, np.array([0.0, 0.0, 1.0]) @ level
    depth = np.minimum.reduce([plane(down, height), plane(ahead, 4.0), plane(-down, 2.6 - height)])
    if table is not None:
        top = plane(down, height - table)
        points = (RAYS * np.where(np.isfinite(top), top, 0.0)[..., None]) @ level.T
        on = (abs(points[..., 0] - 0.2) < 0.7) & (abs(points[..., 2] - 2.5) < 0.6)
        depth = np.where(on, np.minimum(depth, top), depth)
    return depth, -down


@pytest.mark.parametrize(("height", "down"), [(0.7, 0.0), (1.1, 5.0), (2.2, 25.0), (2.4, 45.0), (0.7, -3.0)])
@pytest.mark.parametrize("noise", [0.0, 0.008])
def test_floor_of_a_room(height, down, noise):
    depth, up = room(height, down)
    depth = depth + noise * np.random.default_rng(1).standard_normal(depth.shape)
    floor = FloorFinder(SegmentConfig()).find(frame(depth))
    assert np.degrees(np.arccos(np.clip(floor.up @ up, -1, 1))) < 1.0
    assert floor.height == pytest.approx(height, abs=0.03)


def test_a_table_is_not_the_floor():
    depth, _ = room(1.6, 20.0, table=0.75)
    assert FloorFinder(SegmentConfig()).find(frame(depth)).height == pytest.approx(1.6, abs=0.03)


def test_no_floor_no_answer():
    for depth in (plane([0, 0, 1], 3.0), np.full(RAYS.shape[:2], np.inf), plane([0, -1, 0], 1.2)):
        assert FloorFinder(SegmentConfig()).find(frame(depth)) is None


def test_a_sensor_that_looks_straight_down_is_told_of_it():
    depth = frame(plane([0, 0, 1], 2.6))
    up = up_direction(MountConfig(pitch=90.0))
    floor = FloorFinder(SegmentConfig(), up).find(depth)
    assert floor.height == pytest.approx(2.6, abs=0.02) and floor.up @ up > 0.999


def test_people_tell_of_the_floor_below_a_ceiling():
    """Who stands on a plane tells that it is the floor; who leans against a wall does not."""
    rng = np.random.default_rng(0)
    standing, leaning = (rng.uniform([-0.3, -0.3, z], [0.3, 0.3, 2.6], (500, 3)) for z in (0.9, 2.2))
    finder, seen = FloorFinder(SegmentConfig()), frame(plane([0, 0, 1], 2.6))
    assert finder.find(seen, [leaning]) is None
    assert not finder.update(seen, [standing]) and finder.update(seen, [leaning, standing])
    assert finder.floor.source == BY_PEOPLE and finder.floor.height == pytest.approx(2.6, abs=0.02)


def test_it_stays_until_it_has_moved():
    finder, there = FloorFinder(SegmentConfig()), frame(room(1.1, 5.0)[0])
    assert finder.update(there) and not finder.update(there)
    known = finder.floor
    assert not finder.update(frame(room(1.11, 5.3)[0])) and finder.floor is known  # noise
    moved = frame(room(1.4, 5.0)[0])
    assert not finder.update(moved) and not finder.update(there)  # once is not enough
    assert not finder.update(moved) and finder.update(moved)
    assert finder.floor.height == pytest.approx(1.4, abs=0.03)


def test_frame_on_the_floor():
    up = rotation_x(np.radians(20.0)) @ np.array([0.0, -1.0, 0.0])
    floor = Floor(up, 1.5)
    T = floor.T_camera_floor
    assert np.allclose(T[:3, :3].T @ T[:3, :3], np.eye(3)) and np.linalg.det(T[:3, :3]) > 0
    assert np.allclose(T[:3, 2], up)
    T_floor_camera = np.linalg.inv(T)
    assert np.allclose(T_floor_camera[:3, 3], [0, 0, 1.5])  # the sensor is 1.5 m above it
    left = T_floor_camera[:3, :3] @ [-1.0, 0.0, 0.0]
    assert np.allclose(left, [0, 1, 0])  # what the image has on its left lies to +y
