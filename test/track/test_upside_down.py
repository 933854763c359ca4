"""Images that are upside down are called so, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.track.person_view import FramePeople, see_people
from depth_pose.track.tracked_person import TrackedPerson
from depth_pose.track.upside_down import UpsideDownWatch

CAMERA = Camera(160, 120, 110.0, 110.0, 79.5, 59.5)
HEIGHT_M, WALL_M, PERSON_M = 1.2, 4.0, 3.0


def scene(
    *, with_person: bool, with_floor: bool = True, ceiling_m: float = 9.0
) -> tuple[np.ndarray, np.ndarray]:
    """Depth and labels of a level camera in a room with somebody 1.7 m tall."""
    v, u = np.mgrid[:120, :160]
    x, y = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
    floor = np.where((y > 0) & with_floor, HEIGHT_M / np.maximum(y, 1e-6), np.inf)
    ceiling = np.where(y < 0, (ceiling_m - HEIGHT_M) / np.maximum(-y, 1e-6), np.inf)
    depth = np.minimum(np.minimum(floor, ceiling), WALL_M)
    own = (abs(x * PERSON_M) < 0.25) & (abs(y * PERSON_M - HEIGHT_M + 0.85) < 0.85) & with_person
    return np.where(own, PERSON_M, depth).astype(np.float32), own.astype(np.uint8)


def found(depth: np.ndarray, labels: np.ndarray) -> tuple[DepthFrame, FramePeople]:
    person = TrackedPerson(1, "a", 1.0)
    who = [person] if labels.any() else []
    own = np.where(labels > 0, depth, np.float32(0))
    return DepthFrame(0, "a", depth, CAMERA), see_people(0, "a", CAMERA, own, labels, who)


def doubt(depth: np.ndarray, labels: np.ndarray, frames: int = 16) -> str:
    watch, seen = UpsideDownWatch(SegmentConfig()), found(depth, labels)
    for _ in range(frames):
        watch.look(*seen)
    return watch.doubt


@pytest.mark.parametrize("with_person", [True, False])
@pytest.mark.parametrize("turn", [(-1, -1), (-1, 1)], ids=["hangs upside down", "flipped"])
def test_a_floor_above_is_said(with_person: bool, turn: tuple[int, int]) -> None:
    turned = [np.ascontiguousarray(a[:: turn[0], :: turn[1]]) for a in scene(with_person=with_person)]
    assert "mount.roll" in doubt(*turned)
    assert doubt(*turned, frames=2) == "", "too few looks to tell"


@pytest.mark.parametrize("with_floor", [True, False])
@pytest.mark.parametrize("ceiling_m", [2.4, 9.0])
def test_upright_images_are_not_doubted(with_floor: bool, ceiling_m: float) -> None:
    assert doubt(*scene(with_person=True, with_floor=with_floor, ceiling_m=ceiling_m)) == ""
    assert doubt(*scene(with_person=False, ceiling_m=ceiling_m)) == ""


def test_a_wall_alone_says_nothing() -> None:
    assert doubt(np.full((120, 160), 3.0, np.float32), np.zeros((120, 160), np.uint8)) == ""
