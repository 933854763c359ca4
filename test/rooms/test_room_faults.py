"""One bad camera of three: the room keeps its people, their places and ids, and names the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_room_merger import Room, S, circle, errors
from walkers import Eye

from depth_pose.rooms.timelines import Timelines
from depth_pose.rooms.watch import CameraState
from skeletons import make_skeleton

BAD = 1


class FaultyRoom(Room):
    """`spoil` changes what one camera sends: given its frame number, stamp and skeletons, it returns both."""

    spoil = staticmethod(lambda number, stamp_ns, skeletons: (stamp_ns, skeletons))
    sent = 0

    def frame(self, camera, t):
        if camera != BAD:
            super().frame(camera, t)
            return
        T = np.linalg.inv(self.true_poses[camera])
        stamp_ns = round(t * S)
        skeletons = [
            replace(
                make_skeleton(s.joints @ T[:3, :3].T + T[:3, 3], body_id=s.body_id, stamp_ns=stamp_ns),
                joint_confidence=np.full(19, 0.9, np.float32),
            )
            for s in self.eyes[camera].see(self.path(t))
        ]
        self.sent += 1
        stamp_ns, skeletons = self.spoil(self.sent, stamp_ns, skeletons)
        self.merger.add(camera, stamp_ns, skeletons, t + 0.08)


def make_room(spoil):
    room = FaultyRoom([Eye(seed=c) for c in range(3)], circle)
    room.spoil = spoil
    return room


def ghosts(count):
    def spoil(number, stamp_ns, skeletons):
        rng = np.random.default_rng(number)
        extra = [
            make_skeleton(
                rng.normal(0, 1, (19, 3)) + [0, 0, 3], body_id=f"ghost_{number}_{i}", stamp_ns=stamp_ns
            )
            for i in range(count)
        ]
        return stamp_ns, [*skeletons, *extra]

    return spoil


def stamped(change, every=1, first=20):
    return lambda n, stamp, people: (change(stamp) if n >= first and n % every == 0 else stamp, people)


CASES = {
    "a zero now and then": (stamped(lambda s: 0, every=10), CameraState.USED, ""),
    "an hour ahead now and then": (stamped(lambda s: s + 3600 * S, every=10), CameraState.USED, ""),
    "late now and then": (stamped(lambda s: s - S // 5, every=5), CameraState.USED, ""),
    "the clock goes ahead by an hour": (stamped(lambda s: s + 3600 * S), CameraState.OTHER_TIME, "ahead of"),
    "the clock goes back by 50 s": (stamped(lambda s: s - 50 * S), CameraState.OTHER_TIME, "behind"),
    "a wrong clock from the start": (stamped(lambda s: s + 60 * S, first=0), None, ""),
    "only zeros": (stamped(lambda s: 0), None, ""),
    "20 ghosts a frame": (ghosts(20), CameraState.GHOSTS, "new people"),
    "255 ghosts a frame": (ghosts(255), CameraState.GHOSTS, "new people"),
}


@pytest.mark.parametrize("name", CASES)
def test_one_bad_camera_changes_nothing_for_the_others(name):
    spoil, state, says = CASES[name]
    room = make_room(spoil)
    room.run(3.0)
    answers = room.run(3.0)
    assert all(len(skeletons) == 2 for _, skeletons in answers)
    assert np.mean(errors(room, answers)) < 0.1
    ids = {s.body_id for _, skeletons in room.answers[15:] for s in skeletons}
    assert ids == {"person_1", "person_2"}
    assert room.state(0) == room.state(2) == CameraState.USED
    if state is not None:
        assert room.state(BAD) == state
    else:
        assert room.state(BAD) != CameraState.USED
    assert not says or any(says in line and "cam_1" in line for line in room.news)
    assert len(room.news) <= 3


def test_a_camera_comes_back_when_its_fault_ends():
    for spoil in (ghosts(20), stamped(lambda s: s + 3600 * S, first=0)):
        room = make_room(spoil)
        room.run(2.0)
        assert room.state(BAD) != CameraState.USED
        room.spoil = lambda number, stamp_ns, skeletons: (stamp_ns, skeletons)
        room.run(4.5)
        assert room.state(BAD) == CameraState.USED


def test_ghosts_cost_little_time():
    import time

    room = make_room(ghosts(28))
    room.run(2.0)
    started = time.process_time()
    room.run(2.0)
    assert (time.process_time() - started) / (2.0 * 15) < 0.1  # s a room frame
    assert len(room.merger.tracks.people) <= 130


def test_all_cameras_that_begin_again_begin_a_new_room():
    room = FaultyRoom([Eye(seed=c) for c in range(3)], circle)
    room.run(3.0)
    for camera in range(3):
        room.clocks[camera] = -60.0
    room.spoil = stamped(lambda s: s - 60 * S, first=0)
    room.run(1.0)
    answers = room.run(2.0)
    assert all(len(skeletons) == 2 for _, skeletons in answers)
    assert np.isfinite([s.positions for _, people in answers for s in people]).all()


@pytest.mark.parametrize("seed", range(5))
def test_a_starved_machine_is_no_other_time(seed):
    """Messages of two cameras with one clock that come 0.7 to 2.5 s after their stamps."""
    rng, times, sent = np.random.default_rng(seed), Timelines(2), []
    for camera in range(2):
        stamps_s = 100.0 + np.cumsum(rng.uniform(0.3, 0.9, 80))
        arrivals_s = np.maximum.accumulate(stamps_s + rng.uniform(0.7, 2.5, 80)) + 1e-3 * np.arange(80)
        sent += zip(arrivals_s, [camera] * 80, stamps_s, strict=True)
    judged = [times.judge(camera, round(stamp_s * S), now_s) for now_s, camera, stamp_s in sorted(sent)]
    assert [j.apart_s for j in judged[10:] if j.apart_s] == []
