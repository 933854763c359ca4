"""Clocks of recorded cameras, from people who walk: constant offsets, steps, and clocks that agree."""

from __future__ import annotations

import numpy as np
import pytest
from test_room_merger import S, circle, pose
from walkers import Eye

from depth_pose.rooms.clock_course import ClockCourse, ClockCourses
from skeletons import make_skeleton

POSES = [pose(-4, 0, 0.0), pose(0, -4, 1.57), pose(4, 0, 3.14)]
START_S = 100.0


def courses(clocks, seconds=30.0, noise=0.03):
    """Estimate clocks, each given as the offset (s) at a time (s)."""
    eyes = [Eye(seed=30 + c, noise=noise) for c in range(len(clocks))]
    found = ClockCourses(POSES[: len(clocks)])
    frames = []
    for k in range(round(15 * seconds)):
        for camera, (eye, clock) in enumerate(zip(eyes, clocks, strict=True)):
            t = k / 15 + 0.02 * camera
            T = np.linalg.inv(POSES[camera])
            stamp_ns = round((START_S + t + clock(t)) * S)
            shown = [
                make_skeleton(s.joints @ T[:3, :3].T + T[:3, 3], body_id=s.body_id, stamp_ns=stamp_ns)
                for s in eye.see(circle(t))
            ]
            frames.append((stamp_ns, camera, shown))
    for stamp_ns, camera, shown in sorted(frames, key=lambda one: one[:2]):
        found.add(camera, stamp_ns, stamp_ns, shown)
    return found.courses()


def constant(offset):
    return lambda t: offset


@pytest.mark.parametrize("offset", [0.06, -0.15, 0.25])
def test_a_constant_offset_holds_for_the_whole_recording(offset):
    first, second = courses([constant(0.0), constant(offset)])
    assert first == ClockCourse()
    (found,) = second.offsets_s
    assert found == pytest.approx(offset, abs=0.02)
    where = f"{1e3 * abs(found):.0f} ms {'ahead of' if offset > 0 else 'behind'} that of left"
    assert second.line("right", "left").startswith(f"the clock of right is {where}: its stamps are corrected")


def test_clocks_that_agree_are_left_alone():
    assert all(not any(c.offsets_s) for c in courses([constant(0.0), constant(0.01), constant(-0.01)]))
    assert ClockCourse().line("right", "left") == ""


@pytest.mark.parametrize("step", [0.12, -0.12])
def test_a_step_is_found_in_its_place(step):
    *_, course = courses([constant(0.0), lambda t: step * (t > 14.0)])
    before, after = course.offsets_s
    assert before == 0.0 and after == pytest.approx(step, abs=0.02)
    assert course.since_ns[1] * 1e-9 == pytest.approx(START_S + 14.0, abs=1.0)
    assert course.offset_s(round((START_S + 5.0) * S)) == 0.0
    assert course.offset_s(round((START_S + 20.0) * S)) == after
    assert ", then " in course.line("right", "left")


def test_nobody_says_nothing():
    assert ClockCourses(POSES).courses() == [ClockCourse()] * 3


def test_courses_add_up():
    a, b = ClockCourse((0, 10), (0.1, 0.2)), ClockCourse((5,), (-0.05,))
    both = a.plus(b)
    assert both.since_ns == (0, 5, 10)
    assert both.offsets_s == pytest.approx((0.05, 0.05, 0.15))
    assert both.line("right", "left").startswith("the clock of right is 50 ms ahead of, then 150 ms ahead of")
