"""Clock offsets from people who walk: missing and late frames, filters, rig errors, honest deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_room_merger import S, pose
from walkers import Eye

from depth_pose.core.config import SmoothConfig
from depth_pose.recover.smooth import low_pass
from depth_pose.rooms.clock import ClockOffset
from depth_pose.rooms.merger import RoomMerger
from depth_pose.rooms.walks import WalkSample
from depth_pose.track.state import FilterState
from skeletons import make_skeleton

POSES = [pose(-4, 0, 0.0), pose(4, 0, 3.14)]


def walk(t):
    return [(1.2 * np.sin(0.8 * t), np.cos(0.6 * t))]


def slow(t):
    return [(0.56 * np.sin(0.75 * t), 0.17 * np.sin(0.4 * t))]


def run(
    answered,
    path=walk,
    seconds=60.0,
    clock_s=lambda t: 0.0,
    seed=0,
    smooth=(None, None),
    noise=0.03,
    bias=(0.0, 0.0),
):
    """Play a room at 15 frames a second; return the merger and what it said.

    `answered` returns, for each camera, the stamps that are answered and the times of the answers.
    """
    rng = np.random.default_rng(seed)
    merger = RoomMerger(["left", "right"], POSES)
    sent = [(at, c, t) for c in range(2) for t, at in answered(rng, c, np.arange(0.0, seconds, 1 / 15))]
    eyes = [Eye(seed=seed, noise=noise), Eye(seed=seed + 50, noise=noise, bias=bias)]
    filters, news = [FilterState(), FilterState()], []
    for at, c, t in sorted(sent):
        t += 100.0 + 0.02 * c
        stamp_ns = round((t + (clock_s(t) if c else 0.0)) * S)
        (seen,) = eyes[c].see(path(t))
        joints = seen.joints
        if smooth[c] is not None:
            filters[c] = low_pass(filters[c], joints, stamp_ns, smooth[c])
            joints = filters[c].positions
        T = np.linalg.inv(POSES[c])
        placed = joints @ T[:3, :3].T + T[:3, 3]
        skeleton = make_skeleton(placed, body_id=seen.body_id, stamp_ns=stamp_ns)
        merger.add(
            c, stamp_ns, [replace(skeleton, joint_confidence=np.full(19, 0.9, np.float32))], at + 100.0
        )
        news += merger.watch.news()
    return merger, [line for line in news if "clock of" in line]


def all_frames(rng, camera, times):
    return [(t, t + 0.08) for t in times]


def at_random(rng, camera, times):
    """Half of the frames, each answered 0.1 to 0.25 s later."""
    return [(t, t + rng.uniform(0.1, 0.25)) for t in times if rng.random() < 0.5]


def one_of_two(rng, camera, times):
    """Every second frame of one camera, which is also later."""
    return [(t, t + 0.08 + 0.15 * camera) for t in (times[::2] if camera else times)]


def while_busy(rng, camera, times):
    """The newest frame whenever the last one is done, after 0.1 to 0.4 s."""
    answers, free = [], 0.0
    for t in times:
        if t >= free:
            free = t + rng.uniform(0.1, 0.4)
            answers.append((t, free))
    return answers


@pytest.mark.parametrize("answered", [all_frames, at_random, one_of_two, while_busy])
@pytest.mark.parametrize("clock_s", [0.0, 0.1])
def test_missing_and_late_frames_do_not_shift_a_clock(answered, clock_s):
    merger, news = run(answered, clock_s=lambda t: clock_s)
    if clock_s == 0.0:
        estimate = merger.watch.cameras[1].clock.estimate
        assert news == [] and merger.clock_offsets_s == [0.0, 0.0]
        assert abs(estimate.offset_s) < 0.015 and 0.003 < estimate.deviation_s < 0.03
    else:
        assert len(news) == 1 and "ahead of that of left: its stamps are corrected" in news[0]
        assert merger.clock_offsets_s[1] == pytest.approx(clock_s, abs=0.02)


@pytest.mark.parametrize(
    ("answered", "noise", "filtered"), [(all_frames, 0.005, 0), (all_frames, 0.005, 1), (one_of_two, 0.04, 0)]
)
def test_a_filter_that_holds_one_skeleton_back_is_no_clock(answered, noise, filtered):
    """Somebody slow, whom a suite's filter holds back by up to 7 mm: 20 ms that no clock has."""
    smooth = [None, None]
    smooth[filtered] = SmoothConfig()
    merger, news = run(answered, slow, 40.0, smooth=smooth, noise=noise, bias=(0.0, 0.04))
    estimate = merger.watch.cameras[1].clock.estimate
    assert news == [] and merger.clock_offsets_s == [0.0, 0.0]
    assert 0.008 < abs(estimate.offset_s) < 2.0 * estimate.deviation_s


def test_a_clock_that_is_set_right_is_said_to_agree_again():
    merger, news = run(all_frames, seconds=120.0, clock_s=lambda t: 0.1 * (t < 140.0))
    assert len(news) == 2
    assert " ms ahead of that of left:" in news[0] and "of right is again that of left:" in news[1]
    assert merger.clock_offsets_s[1] == pytest.approx(0.0, abs=0.04)


def test_the_deviation_holds_for_errors_that_last():
    """Errors correlated over half a second, as trackers have, and a rig 5 cm off."""
    rng, far = np.random.default_rng(0), 0
    for _ in range(100):
        clock, error = ClockOffset(), np.zeros(2)
        for k in range(300):
            t = k / 15
            velocity = np.array([np.cos(0.8 * t), 0.7 * np.sin(0.6 * t)])
            error = 0.87 * error + 0.015 * rng.standard_normal(2)
            clock.add(WalkSample(1, k, 0.05 - 0.03 * velocity + error, velocity, 1 / 15))
        estimate = clock.estimate
        assert estimate.deviation_s < 0.03
        far += abs(estimate.offset_s - 0.03) > 3.0 * estimate.deviation_s
    assert far <= 2
