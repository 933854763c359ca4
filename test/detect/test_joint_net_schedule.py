"""Who is looked at closely again, and who not yet."""

from __future__ import annotations

import numpy as np
import pytest

from crowd import person, seen
from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.measurement import CropMask, CropView, JointMeasurement
from depth_pose.detect.candidates import Candidates
from depth_pose.detect.finder import TorsoDetection
from depth_pose.detect.joint_net_schedule import JointNetSchedule
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.tuning import DetectTuning

STEP_NS = 33_000_000
CAMERA = Camera(32, 24, 100.0, 100.0, 15.5, 11.5)


def at(x: float, label: int = 1, z: float = 3.0) -> TorsoDetection:
    return TorsoDetection(label, 0.99, np.array([x, 0.0, z]))


FAR, FARTHER = at(2.0, label=2), at(4.0, label=3)


class Watcher:
    """Counts who is looked at in a frame."""

    def __init__(self, every: int = 2, probability: float = 0.99, speed: str = "normal") -> None:
        self.looks, self.probability, self.told = JointNetSchedule(every, speed), probability, 0
        self.sigma_m, self.expected = 0.05, list[np.ndarray | None]()
        self.stamp_ns = 10**18
        self.depth = np.full((24, 32), 3.0, np.float32)

    def look(self, person: TorsoDetection, expected: np.ndarray | None) -> JointMeasurement:
        self.told += 1
        self.expected.append(expected)
        return JointMeasurement(
            places=np.tile(person.torso, (19, 1)).astype(np.float32),
            sigma=np.full((19, 2), self.sigma_m, np.float32),
            confidence=np.full(19, 0.8, np.float32),
            heels=np.tile([*person.torso, 0.05, 0.05], (2, 1)).astype(np.float32),
            probability=self.probability,
            mask=CropMask(np.zeros((8, 8), np.float32), CropView(*person.torso.tolist(), 0.3)),
        )

    def see(self, *people: TorsoDetection, step_ns: int = STEP_NS, moves: slice | None = slice(None)) -> int:
        """Return the number of people looked at in the next frame, in which rows of their surface move."""
        self.stamp_ns, self.told, self.expected = self.stamp_ns + step_ns, 0, []
        self.depth = self.depth.copy()
        if moves is not None:
            self.depth[moves] += np.float32(0.1)
        labels = np.zeros(self.depth.shape, np.uint8)
        for p in people:
            labels[:, 8 * (p.label - 1) : 8 * p.label] = p.label
        found = Candidates(self.depth, labels, CAMERA, people, 0)
        looks = self.looks.renew(found, self.stamp_ns, self.look)
        self.seen, self.calm = [k.seen for k in looks], [k.is_calm for k in looks]
        assert len(self.seen) == len(people)
        return self.told


def test_what_was_seen_goes_along_with_the_person() -> None:
    watcher = Watcher()
    assert [watcher.see(at(0.02 * k), FAR, FARTHER) for k in range(4)] == [3, 2, 2, 2]
    sigmas = set()
    for x in (0.08, 0.1, 0.12):
        watcher.see(at(x), FAR, FARTHER)
        seen = watcher.seen[0]
        for points in (seen.places, seen.heels[:, :3]):
            np.testing.assert_allclose(points, np.tile([x, 0.0, 3.0], (len(points), 1)), atol=1e-6)
        assert (seen.heels[:, 3:] == seen.sigma[0]).all()
        sigmas.add(float(seen.sigma[0, 0]))
    assert min(sigmas) == np.float32(0.05)
    assert max(sigmas) > 0.08  # of a reused look


def test_two_people_are_looked_at_in_every_frame() -> None:
    watcher = Watcher()
    assert [watcher.see(at(0.0)) for _ in range(3)] == [1, 1, 1]
    assert [watcher.see(at(0.0), FAR) for _ in range(3)] == [2, 2, 2]


def test_who_is_calm_is_looked_at_now_and_then() -> None:
    watcher = Watcher()
    watcher.see(at(0.0))
    looks = [watcher.see(at(0.0), moves=None) for _ in range(12)]
    assert looks == [0, 0, 1] * 4
    assert watcher.see(at(0.0), moves=None) == 0 and watcher.calm == [True]
    assert watcher.seen[0].sigma[0, 0] == pytest.approx(np.hypot(0.05, 0.02))


@pytest.mark.parametrize("calm_frames", [1, 2])
def test_who_begins_to_move_is_looked_at_in_that_frame(calm_frames: int) -> None:
    watcher = Watcher()
    watcher.see(at(0.0))
    assert [watcher.see(at(0.0), moves=None) for _ in range(calm_frames)] == [0] * calm_frames
    assert watcher.see(at(0.0), moves=slice(0, 6)) == 1 and watcher.calm == [False]
    assert watcher.see(at(0.0), moves=slice(0, 6)) == 1


def test_slow_movement_adds_up() -> None:
    watcher = Watcher()
    watcher.see(at(0.0))
    looks, rows = [], np.zeros((24, 1), np.float32)
    rows[:6] = 0.015  # less than what counts in a single frame
    for _ in range(4):
        watcher.depth = watcher.depth + rows
        looks.append(watcher.see(at(0.0), moves=None))
    assert looks == [0, 0, 1, 0]


def test_noise_moves_nobody() -> None:
    watcher, rng = Watcher(), np.random.default_rng(0)
    still = watcher.depth.copy()
    for _ in range(2):
        watcher.depth = still + np.where(rng.random(still.shape) < 0.3, 0.2, 0.0).astype(np.float32)
        told = watcher.see(at(0.0), moves=None)
    assert told == 0


@pytest.mark.parametrize("speed", ["normal", "high"])
def test_a_silhouette_that_flickers_moves_nobody(speed: str) -> None:
    """Every pixel changes, some to nearer and some to farther."""
    watcher = Watcher(speed=speed)
    watcher.see(at(0.0))
    flicker = np.where(np.indices(watcher.depth.shape).sum(axis=0) % 2, 0.2, -0.2).astype(np.float32)
    watcher.depth = watcher.depth + flicker
    assert watcher.see(at(0.0), moves=None) == 0 and watcher.calm == [True]


def test_speed() -> None:
    low, high = Watcher(speed="low"), Watcher(speed="high")
    assert [low.see(at(0.0), moves=None) for _ in range(3)] == [1, 1, 1]
    few = slice(0, 4)
    assert [high.see(at(0.0), moves=few) for _ in range(4)] == [1, 0, 1, 0] and high.calm == [True]
    assert [high.see(at(0.0)) for _ in range(4)] == [1, 0, 1, 0] and high.calm == [False]


def test_people_take_turns() -> None:
    watcher = Watcher()
    crowd = [at(float(x), label=x + 1) for x in range(4)]
    assert [watcher.see(*crowd) for _ in range(4)] == [4, 2, 2, 2]


def test_everybody_is_looked_at_where_that_is_asked_for() -> None:
    watcher = Watcher(every=1)
    assert [watcher.see(at(0.0), FAR, FARTHER) for _ in range(3)] == [3, 3, 3]


@pytest.mark.parametrize("probability", [0.3, 0.8])
def test_who_may_be_a_thing_is_looked_at_in_every_frame(probability: float) -> None:
    watcher = Watcher(probability=probability)
    assert [watcher.see(at(0.0), FAR, FARTHER) for _ in range(3)] == [3, 3, 3]


@pytest.mark.parametrize("step_ns", [101_000_000, 0, -STEP_NS])
def test_no_look_is_carried_for_long_or_back_in_time(step_ns: int) -> None:
    watcher = Watcher()
    watcher.see(at(0.0), FAR, FARTHER)
    assert watcher.see(at(0.0), FAR, FARTHER, step_ns=step_ns) == 3


@pytest.mark.parametrize(("aside", "looks"), [(0.0, 2), (0.2, 3)])
def test_who_jumps_is_looked_at(aside: float, looks: int) -> None:
    watcher = Watcher(every=4)
    for _ in range(2):
        watcher.see(at(0.0), FAR, FARTHER)
    jumped = [at(aside), at(2.0 + aside, label=2), at(4.0 + aside, label=3)]
    assert watcher.see(*jumped) == looks


@pytest.mark.parametrize(("apart", "looks"), [(0.5, 2), (0.3, 3)])
def test_people_who_stand_close_together_are_looked_at(apart: float, looks: int) -> None:
    watcher = Watcher(every=4)
    crowd = [at(apart * k, label=k + 1) for k in range(3)]
    watcher.see(*crowd)
    assert watcher.see(*crowd) == looks


def test_a_reset_forgets_everybody() -> None:
    watcher = Watcher(every=3)
    watcher.see(at(0.0), FAR, FARTHER)
    watcher.looks.reset()
    assert watcher.see(at(0.0), FAR, FARTHER) == 3


def test_people_who_stand_still_are_seen_the_same_in_between() -> None:
    """What is carried along is what the look said, up to what a background that is now known changes."""
    frames = [seen(k, [person(0, -1.0, 3.4), person(0, 0.0, 3.2), person(0, 0.9, 2.8)]) for k in range(4)]
    carried, fresh = (LearnedSegmenter(SegmentConfig(), tuning=DetectTuning(look_every=n)) for n in (2, 1))
    for frame in frames:
        pairs = list(zip(*(s.segment(frame).detections for s in (carried, fresh)), strict=True))
        assert len(pairs) == 3
        for a, b in pairs:
            apart = np.abs(a.measured.places - b.measured.places)
            assert np.median(apart) < 0.005
            # who was looked at in another frame has that frame's noise
            assert (apart < 0.02 + b.measured.sigma.max(axis=1)[:, None]).all()
            assert a.probability == pytest.approx(b.probability, abs=0.05)


@pytest.mark.parametrize(
    ("probability", "sigma_m", "is_good"),
    [
        (0.99, 0.05, True),
        (0.85, 0.05, False),  # may be no person
        (0.99, 0.15, False),  # a limb is hidden
    ],
)
@pytest.mark.parametrize("speed", ["normal", "high"])
def test_joints_of_who_was_measured_well_are_expected(
    speed: str, probability: float, sigma_m: float, is_good: bool
) -> None:
    watcher = Watcher(probability=probability, speed=speed)
    watcher.sigma_m, looks = sigma_m, 0
    for k in range(4):  # also after a frame in which the measurement was reused
        x = 0.02 * k
        looks += watcher.see(at(x))
        for expected in watcher.expected:
            assert (expected is not None) == (is_good and k > 0), "nobody expects somebody new"
            if expected is not None:
                np.testing.assert_allclose(expected, np.tile([x, 0.0, 3.0], (19, 1)), atol=1e-6)
    assert looks > 1
