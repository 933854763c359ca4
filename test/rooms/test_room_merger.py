"""Cameras whose skeletons are merged as they come: hand-overs, and cameras that stop, lag, or are moved."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from walkers import Eye

from depth_pose.core.rotations import rotation_z
from depth_pose.core.skeleton import JOINT_INDEX, Source
from depth_pose.rooms.merger import RoomMerger
from depth_pose.rooms.watch import CameraState
from skeletons import make_skeleton

S = 1_000_000_000
PELVIS = JOINT_INDEX["pelvis"]


def pose(x: float, y: float, yaw: float) -> np.ndarray:
    """A camera in the room (4, 4), 1.5 m high."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_z(np.array(yaw)) @ [[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]], [x, y, 1.5]
    return T


@dataclass
class Room:
    """Cameras at 15 frames a second, people on given paths, and a merger."""

    eyes: list[Eye]
    path: object
    poses: list = field(default_factory=lambda: [pose(-4, 0, 0.0), pose(0, -4, 1.57), pose(4, 0, 3.14)])
    delays: dict = field(default_factory=dict)
    clocks: dict = field(default_factory=dict)
    now_s: float = 100.0

    def __post_init__(self):
        count = len(self.eyes)
        self.poses = self.poses[:count]
        self.merger = RoomMerger([f"cam_{c}" for c in range(count)], self.poses)
        self.true_poses, self.news, self.answers = list(self.poses), [], []

    def frame(self, camera, t):
        T = np.linalg.inv(self.true_poses[camera])
        stamp_ns = round((t + self.clocks.get(camera, 0.0)) * S)
        skeletons = [
            replace(
                make_skeleton(s.joints @ T[:3, :3].T + T[:3, 3], body_id=s.body_id, stamp_ns=stamp_ns),
                joint_confidence=np.full(19, 0.9, np.float32),
            )
            for s in self.eyes[camera].see(self.path(t))
        ]
        self.merger.add(camera, stamp_ns, skeletons, t + self.delays.get(camera, 0.08))

    def run(self, seconds, silent=()):
        """Return the skeletons that came, a list for each frame of the first camera heard."""
        count, answers = len(self.eyes), []
        loud = [c for c in range(count) if c not in silent]
        for k in range(round(15 * seconds)):
            for c in loud:
                self.frame(c, self.now_s + k / 15 + 0.02 * c)
            t = self.now_s + k / 15 + 0.02 * loud[-1]
            answers.append((t, self.merger.skeletons_at(round((t + self.clocks.get(0, 0.0)) * S))))
            self.news += self.merger.watch.news()
        self.now_s += seconds
        self.answers += answers
        return answers

    def state(self, camera):
        return self.merger.watch.cameras[camera].state


def circle(t):
    return [(np.cos(0.8 * t), np.sin(0.8 * t)), (1.5 * np.cos(0.5 * t + 3), 1.5 * np.sin(0.5 * t + 3) + 0.5)]


def errors(room, answers):
    out = []
    for t, skeletons in answers:
        for skeleton in skeletons:
            truth = np.array(room.path(t))
            out.append(np.linalg.norm(truth - skeleton.positions[PELVIS, :2], axis=1).min())
    return np.array(out)


def test_people_are_where_they_are():
    room = Room([Eye(seed=c) for c in range(3)], circle)
    answers = room.run(6.0)
    assert all(len(skeletons) == 2 for _, skeletons in answers)
    assert {s.body_id for _, skeletons in answers for s in skeletons} == {"person_1", "person_2"}
    assert {s.source for _, skeletons in answers for s in skeletons} == {Source.REFINED}
    assert np.percentile(errors(room, answers[5:]), 90) < 0.03
    assert room.news == []


def test_a_hand_over_keeps_the_id_and_the_place():
    room = Room([Eye(right=0.3, seed=1), Eye(left=-0.3, seed=2)], lambda t: [(2.0 * np.sin(t), 0.0)])
    answers = room.run(10.0)
    assert {s.body_id for _, skeletons in answers for s in skeletons} == {"person_1"}
    assert all(len(skeletons) == 1 for _, skeletons in answers)
    assert errors(room, answers[3:]).max() < 0.12


@pytest.mark.parametrize("seed", [3, 5, 7])
def test_on_a_slow_machine_one_person_keeps_one_id(seed):
    """Two cameras of 1 to 7 frames a second, whose messages come .3 to 1.5 s after their stamps."""
    room = Room([Eye(seed=seed), Eye(seed=seed + 50)], lambda t: [(np.cos(0.6 * t), np.sin(0.6 * t))])
    rng, sent = np.random.default_rng(seed), []
    for camera in range(2):
        t, last = 100.0, 0.0
        while t < 140.0:
            t += rng.uniform(0.15, 0.9)
            last = max(last + 0.01, t + rng.uniform(0.3, 1.5))
            sent.append((last, camera, t))
    answers = []
    for arrival, camera, t in sorted(sent):
        room.delays[camera] = arrival - t
        room.frame(camera, t)
        answers += room.merger.skeletons_at(round(t * S))
    assert {s.body_id for s in answers} == {"person_1"} and len(answers) > 50
    assert any("stopped" in line for line in room.merger.watch.news())


def test_a_camera_stops_and_returns():
    room = Room([Eye(seed=3), Eye(seed=4)], circle)
    room.run(2.0)
    room.run(3.0, silent=(1,))
    assert room.state(1) == CameraState.STOPPED
    assert [line for line in room.news if "stopped" in line] == room.news
    assert room.news[0].startswith("cam_1 stopped: nothing came for 1.0")
    room.run(2.0)
    assert room.state(1) == CameraState.USED
    assert room.news[1:] == ["cam_1 takes part again"]
    assert all(len(skeletons) == 2 for _, skeletons in room.answers)
    assert {s.body_id for _, skeletons in room.answers for s in skeletons} == {"person_1", "person_2"}


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize("way", [0.45, 1.3])
def test_a_camera_that_is_moved_is_left_out_until_it_is_put_back(camera, way):
    """It is one of two: the one whose people jumped."""
    room = Room([Eye(seed=5), Eye(seed=6)], circle)
    room.run(2.0)
    shift = np.eye(4)
    shift[:2, 3] = -0.6 * way, 0.8 * way
    room.true_poses[camera] = shift @ room.poses[camera]
    room.run(4.0)
    assert room.state(camera) == CameraState.MOVED
    assert room.state(1 - camera) == CameraState.USED
    assert len(room.news) == 1
    assert f"cam_{camera} was moved: it sees people" in room.news[0]
    answers = room.run(1.0)
    assert all(len(skeletons) == 2 for _, skeletons in answers)
    assert errors(room, answers).max() < 0.1
    room.true_poses[camera] = room.poses[camera]
    room.run(2.0)
    assert room.news[1:] == [f"cam_{camera} takes part again"]
    assert {s.body_id for _, skeletons in answers for s in skeletons} == {"person_1", "person_2"}


@pytest.mark.parametrize("camera", [0, 1])
def test_frames_in_bursts_do_not_hide_which_camera_was_moved(camera):
    """After a stall several frames have nearly the same stamps: velocities between them are noise."""
    for seed in range(8):
        rng, room = np.random.default_rng(seed), Room([Eye(seed=2 * seed), Eye(seed=2 * seed + 1)], circle)
        for moment in range(180):
            if moment == 80:
                room.true_poses[camera] = room.poses[camera].copy()
                room.true_poses[camera][0, 3] += 0.6
            stalled = rng.random() < 0.1
            room.now_s += 0.3 if stalled else 0.05
            for k in range(6 if stalled else 1):
                for eye in range(2):
                    room.frame(eye, room.now_s + 1e-4 * (2 * k + eye))
            room.now_s += 1e-3
        assert [room.state(c) for c in (camera, 1 - camera)] == [CameraState.MOVED, CameraState.USED]


def test_of_three_the_one_that_disagrees_was_moved():
    """Slowly, so that nobody jumps."""
    room = Room([Eye(seed=c) for c in range(3)], circle)
    room.run(1.0)
    for k in range(40):
        room.true_poses[0] = room.poses[0].copy()
        room.true_poses[0][1, 3] += 0.01 * k
        room.run(1 / 15)
    room.run(4.0)
    assert [room.state(c) for c in range(3)] == [CameraState.MOVED, CameraState.USED, CameraState.USED]


def test_a_camera_that_lags_is_left_out():
    room = Room([Eye(seed=7), Eye(seed=8)], circle)
    room.run(2.0)
    room.delays[1] = 0.5
    room.run(4.0)
    assert room.state(1) == CameraState.LAGS
    assert room.news == [
        "cam_1 lags: its messages come 0.42 s later after their stamps than the others'; "
        "its computer is busy, or its clock is wrong. It is left out"
    ]
    room.delays[1] = 0.1
    room.run(4.0)
    assert room.news[1:] == ["cam_1 takes part again"]


@pytest.mark.parametrize(("offset_s", "told"), [(0.015, False), (0.06, True), (-0.08, True)])
def test_clocks_that_differ(offset_s, told):
    """20 ms do no harm; more is told, and corrected by how people walk."""
    room = Room([Eye(seed=9, noise=0.03), Eye(seed=10, noise=0.03)], lambda t: [(1.5 * np.sin(t), np.cos(t))])
    room.clocks[1] = offset_s
    answers = room.run(25.0)
    assert bool(room.news) == told
    assert all(len(skeletons) == 1 for _, skeletons in answers)
    if told:
        assert room.merger.clock_offsets_s[1] == pytest.approx(offset_s, abs=0.015)
        assert f"{'ahead of' if offset_s > 0 else 'behind'} that of cam_0" in room.news[0]
    assert np.percentile(errors(room, answers[-60:]), 90) < 0.06


@pytest.mark.parametrize(
    ("bad", "way", "turn_deg", "off"), [(0, 0.24, 0, "0.24"), (1, 1.2, 0, "1.2"), (2, 0.0, 90, "1.")]
)
def test_a_camera_that_stands_elsewhere_than_the_rig_says_is_named(bad, way, turn_deg, off):
    """Within seconds, once, and as long as it lasts; a better rig ends it."""
    room = Room([Eye(seed=20 + c) for c in range(3)], circle)
    T = pose(0.0, 0.0, np.radians(turn_deg)) @ np.linalg.inv(pose(way, 0.0, 0.0))
    room.merger.T_room_camera[bad] = T @ room.poses[bad]
    room.run(8.0)
    (line,) = room.news
    assert line.startswith(f"cam_{bad} does not fit cam_") and line.endswith("calibrate again")
    assert f"off by about {off}" in line and ("turned by 90 degrees" in line) == (turn_deg == 90)
    room.run(2.0)
    misfits = [of.misfit for of in room.merger.watch.cameras]
    assert misfits[bad].startswith(f"cam_{bad} does not fit") and sum(map(bool, misfits)) == 1
    room.merger.T_room_camera[bad] = room.poses[bad]
    room.run(5.0)
    assert not any(of.misfit for of in room.merger.watch.cameras)
    assert len(room.news) == 1


def test_nobody_and_one_camera():
    merger = RoomMerger(["a", "b"], [pose(0, 0, 0.0), pose(1, 0, 0.0)])
    merger.add(0, S, [])
    merger.add(1, S, [make_skeleton(np.zeros((0, 3)), source=Source.LOST)])
    assert merger.skeletons_at(S) == ()
    merger.add(1, 2 * S, [make_skeleton(np.tile([0.0, 0.0, 2.0], (19, 1)))])
    (one,) = merger.skeletons_at(2 * S)
    assert (one.body_id, one.frame_id, one.stamp_ns) == ("person_1", "room", 2 * S)
    assert np.allclose(one.positions, [3.0, 0.0, 1.5])
    assert merger.skeletons_at(2 * S + 300_000_000) == ()


def test_what_one_camera_takes_for_a_person_is_not_reported():
    """A coat that one camera sees with little confidence; then another camera sees it as well."""
    merger = RoomMerger(["a", "b"], [pose(0, 0, 0.0), pose(0, 1, 0.0)])

    def show(camera, k, confidence):
        positions = np.tile([camera * 1.0, 0.0, 2.0], (19, 1))  # both at 2 m along x, y = 0
        merger.add(camera, k * S // 15, [make_skeleton(positions, confidence=confidence)])
        return merger.skeletons_at(k * S // 15)

    assert all(show(0, k, 0.15) == () for k in range(30))
    assert any(len(show(0, k, 0.8)) == 1 for k in range(30, 45))  # it moves, and is somebody
    merger.reset()
    assert show(0, 50, 0.15) == ()
    (shared,) = show(1, 50, 0.15)
    assert shared.body_id == "person_2"
