"""Images of a sensor that hangs upside down: a hint, and only then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.types import DepthFrame
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.detect.upside_down import UpsideDownWatch

STEP_NS = 1_100_000_000


def turned(frame: DepthFrame) -> DepthFrame:
    return replace(frame, depth=np.ascontiguousarray(frame.depth[::-1, ::-1]))


def watch_of(frame: DepthFrame, anybody=(False,) * 5) -> UpsideDownWatch:
    watch = UpsideDownWatch(SegmentConfig(), "mount.roll: 180")
    for k, is_anybody in enumerate(anybody):
        watch.look(replace(frame, stamp_ns=k * STEP_NS), is_anybody)
    return watch


def room() -> DepthFrame:
    """A wall, and a floor 1.1 m below the sensor."""
    camera = Camera(176, 144, 170.0, 170.0, 87.5, 71.5)
    below = np.maximum(np.arange(144) - camera.cy, 1e-3) / camera.fy
    rows = np.minimum(4.8, 1.1 / below).astype(np.float32)
    return DepthFrame(0, "", np.repeat(rows[:, None], 176, axis=1), camera)


@pytest.mark.parametrize("frame", [room(), sample_frame()], ids=["empty", "somebody"])
def test_the_floor_above_is_said(frame: DepthFrame) -> None:
    assert "upside down; mount.roll: 180 turns" in watch_of(turned(frame)).hint
    assert not watch_of(frame).hint


def test_nothing_is_said_where_people_are_found_or_it_was_a_moment() -> None:
    assert not watch_of(turned(room()), [False, False, True, False, False, False]).hint
    assert not watch_of(turned(room()), [False, False]).hint


def test_a_wall_alone_says_nothing() -> None:
    frame = room()
    wall = replace(frame, depth=np.full_like(frame.depth, 3.0))
    assert not watch_of(wall).hint and not watch_of(turned(wall)).hint
