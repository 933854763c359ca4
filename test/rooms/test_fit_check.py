"""Cameras that do not fit each other are named, with how far they are off; cameras that fit never are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_room_merger import pose
from walkers import standing

from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.rooms.fit_check import FitCheck
from skeletons import make_skeleton

S = 1_000_000_000
NAMES = ("left", "middle", "right")


def walker(t, phase=0.0):
    """Somebody who walks in a curve, turning with it."""
    x, y = 1.4 * np.cos(0.7 * t + phase), 0.9 * np.sin(1.1 * t + phase)
    return standing(x, y, yaw=0.7 * t + phase)


def moved(way=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotvec_to_matrix(np.radians(np.array(turn, float))), way
    return T


def lines(wrong, people=1, seconds=8.0, clock_s=0.0, camera=1, cameras=3, views=None):
    """What is said of cameras of which one believes that it stands elsewhere, by a transform in the room."""
    rng, check = np.random.default_rng(0), FitCheck(NAMES[:cameras])
    for k in range(round(15 * seconds)):
        for c in range(cameras):
            t = k / 15 + 0.02 * c
            seen = [p for p in range(people) if views is None or p in views[c]]
            joints = {p: walker(t, 2.0 * p) + rng.normal(0, 0.02, (19, 3)) for p in seen}
            T = wrong if c == camera else np.eye(4)
            placed = [
                replace(
                    make_skeleton(j @ T[:3, :3].T + T[:3, 3], body_id=f"body_{p}", stamp_ns=k),
                    joint_confidence=np.full(19, 0.9, np.float32),
                )
                for p, j in joints.items()
            ]
            check.add(c, round((100 + t + (clock_s if c == camera else 0.0)) * S), placed)
    return list(dict.fromkeys(check.judge_all().values()))


@pytest.mark.parametrize("people", [1, 2, 4])
@pytest.mark.parametrize("cameras", [2, 3])
def test_cameras_that_fit_are_not_named(people, cameras):
    assert lines(np.eye(4), people, cameras=cameras) == []
    assert lines(moved((0.05, 0.03, 0.02), (0, 0, 1.0)), people, cameras=cameras) == []
    assert lines(np.eye(4), people, clock_s=0.03, cameras=cameras) == []


@pytest.mark.parametrize("people", [1, 2])
@pytest.mark.parametrize(
    ("wrong", "off"),
    [
        (moved((0.24, 0.0, 0.0)), 0.24),
        (moved((1.0, 0.6, 0.1)), 1.2),
        (moved((0.0, 0.0, 4.0)), 4.0),
        (moved(turn=(0.0, 0.0, 90.0)), None),
        (moved(turn=(90.0, 0.0, 0.0)), None),  # another axis is up
        (pose(0, -4, 1.57), None),  # the inverse, or another camera's place
        (np.linalg.inv(pose(2, 1, 0.5)), None),
    ],
)
def test_a_camera_that_does_not_fit_is_named_with_its_distance(wrong, off, people):
    (line,) = lines(wrong, people)
    assert line.startswith("middle does not fit ") and line.endswith("calibrate again")
    if off is not None:
        assert f"off by about {off:.2g} m;" in line
    else:
        assert "turned by" in line


@pytest.mark.parametrize("camera", [0, 1])
def test_two_cameras_alone_are_both_named(camera):
    """Nobody knows which of them is wrong."""
    (line,) = lines(moved((1.0, 0.6, 0.1)), camera=camera, cameras=2)
    assert line == "left and middle do not agree: off by about 1.2 m; calibrate again"


def test_a_clock_that_differs_is_named():
    (line,) = lines(np.eye(4), clock_s=0.5)
    assert line.startswith("the clock of middle is about 0.5 s ahead of that of ")


def test_different_people_say_nothing():
    """Each camera sees somebody else, who walks another way."""
    assert lines(moved((1.0, 0, 0)), people=3, views=[{0}, {1}, {2}]) == []


def test_many_ids_are_bounded():
    check = FitCheck(NAMES)
    for k in range(500):
        check.add(0, k, [make_skeleton(walker(0.0), body_id=f"ghost_{k}")])
    assert len(check) == 40
