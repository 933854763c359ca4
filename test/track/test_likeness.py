"""How well a detection fits a track: densities, odds and likelihood ratios."""

from __future__ import annotations

import math

import numpy as np
import pytest

from depth_pose.core.measurement import TYPICAL_ERROR_M, JointMeasurement
from depth_pose.core.skeleton import JOINT_NODES, rest_nodes
from depth_pose.detect.segmentation import Detection
from depth_pose.track import likeness
from depth_pose.track.likeness import Size, Traits

HERE = np.array([0.3, 0.1, 3.0])


def seen(joints: np.ndarray, error_m: float = 0.05) -> Traits:
    confidence = np.full(len(joints), 1.0 / (1.0 + (error_m / TYPICAL_ERROR_M) ** 2), np.float32)
    return traits(joints, confidence)


def traits(joints: np.ndarray, confidence: np.ndarray) -> Traits:
    sigma = np.full((len(joints), 2), 0.05, np.float32)
    measured = JointMeasurement(joints.astype(np.float32), sigma, confidence)
    return likeness.traits_of(Detection(1, HERE, 1.0, measured))


def rest(stature: float = 1.7) -> np.ndarray:
    return stature * rest_nodes()[JOINT_NODES] + HERE


@pytest.mark.parametrize("stature", [1.1, 1.7, 2.0])
def test_the_size_is_the_stature_wherever_and_however_they_stand(stature) -> None:
    turned = rest(stature) @ np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    for joints in (rest(stature), turned):
        size = seen(joints).size
        assert size is not None
        assert math.exp(size.log_m) == pytest.approx(stature, rel=1e-4)


def test_the_stated_error_of_the_size_is_its_error() -> None:
    """Over many draws of joints with the stated errors; what is kept for the build comes on top."""
    rng = np.random.default_rng(0)
    error_m = 0.05
    sizes = [
        seen(rest() + rng.normal(0.0, error_m / math.sqrt(3.0), (19, 3)), error_m).size for _ in range(400)
    ]
    spread = np.std([s.log_m for s in sizes if s is not None])
    stated = np.mean([math.sqrt(s.variance - 0.03**2) for s in sizes if s is not None])
    assert 0.6 < spread / stated < 1.6


def test_joints_that_nobody_trusts_do_not_move_the_size() -> None:
    joints = rest()
    confidence = np.full(19, 0.8, np.float32)
    joints[-1] += 0.5
    joints[5] += 0.5
    confidence[[5, -1]] = 1e-6
    size = traits(joints, confidence).size
    assert size is not None
    assert math.exp(size.log_m) == pytest.approx(1.7, rel=0.01)


def test_more_looks_at_a_size_make_it_surer_and_looks_at_once_hardly_do() -> None:
    one = Size(math.log(1.7), 0.01)
    slow = fast = one
    for _ in range(6):
        slow, fast = slow.merged(Size(math.log(1.6), 0.01), 0.2), fast.merged(Size(math.log(1.6), 0.01), 0.02)
    assert slow.variance < fast.variance < one.variance
    assert math.log(1.6) < slow.log_m < fast.log_m < math.log(1.7)


@pytest.mark.parametrize("gap_s", [0.033, 0.2, 1.0])
@pytest.mark.parametrize("velocity", [0.0, 1.2])
def test_the_density_of_a_place_sums_to_one_over_the_floor(gap_s, velocity) -> None:
    step = 0.02
    line = np.arange(-6.5, 6.5, step)
    was, way = np.array([0.0, 0.0, 8.0]), np.array([velocity, 0.0, 0.0])
    total = (
        sum(likeness.place_density(was, way, was + [x, 0.0, z], gap_s) for x in line[::4] for z in line[::4])
        * (4 * step) ** 2
    )
    assert total == pytest.approx(1.0, abs=0.04)


def test_a_place_is_likeliest_where_the_motion_leads_and_beyond_reach_impossible() -> None:
    velocity = np.array([1.0, 0.0, 0.0])
    ahead, behind, far = (
        likeness.place_density(HERE, velocity, HERE + [x, 0.0, 0.0], 0.4) for x in (0.4, -0.4, 3.0)
    )
    assert ahead > 3.0 * behind > 0.0
    assert far == 0.0


def test_the_longer_hidden_the_less_likely_back_at_once() -> None:
    odds = [likeness.seen_odds(gap_s, 0.033, is_proven=True) for gap_s in (0.033, 0.1, 0.5, 2.0, 5.0)]
    assert odds == sorted(odds, reverse=True)
    assert odds[0] > 2.0 > 0.0 > odds[1]
    assert likeness.seen_odds(0.1, 0.033, is_proven=False) < odds[1]


def test_the_rate_of_return_does_not_depend_on_the_frame_rate() -> None:
    """Over a second, hidden for two before: the chance to be seen at 5 and at 30 frames a second."""

    def chance(fps: int) -> float:
        odds = [likeness.seen_odds(2.0 + (k + 1) / fps, 1.0 / fps, is_proven=True) for k in range(fps)]
        return 1.0 - math.prod(1.0 / (1.0 + math.exp(o)) for o in odds)

    assert chance(5) == pytest.approx(chance(30), abs=0.02)


def test_a_size_speaks_for_its_person_and_against_others() -> None:
    adult, child = Size(math.log(1.8), 0.001), Size(math.log(1.2), 0.001)
    again = Size(math.log(1.75), 0.005)
    assert likeness.size_gain(adult, again) > 0.5
    assert likeness.size_gain(child, again) < -5.0
    assert likeness.size_gain(None, again) == likeness.size_gain(adult, None) == 0.0


def test_a_pose_speaks_for_its_person_for_half_a_second() -> None:
    rng = np.random.default_rng(1)
    one = seen(rest())
    same, other = seen(rest() + rng.normal(0.0, 0.01, (19, 3))), seen(rest() + rng.normal(0.0, 0.15, (19, 3)))
    gains = [likeness.pose_gain(one, same, gap_s) for gap_s in (0.033, 0.2, 0.5)]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > 2.0
    assert likeness.pose_gain(one, other, 0.033) < -1.0
    assert likeness.pose_gain(one, same, 1.0) == likeness.pose_gain(one, other, 1.0) == 0.0
    shifted = seen(rest() + [0.5, 0.0, 0.2])
    assert likeness.pose_gain(one, shifted, 0.033) == pytest.approx(
        likeness.pose_gain(one, one, 0.033), abs=1e-3
    )


def test_of_two_in_one_place_the_less_certain_is_a_part() -> None:
    sure, part = seen(rest(), 0.05), seen(rest(1.2), 0.2)
    apart = Traits(HERE + [0.5, 0.0, 0.0], sure.size, sure.joints, sure.variance)
    assert likeness.fragments([sure, part, apart]) == {1}
    assert likeness.fragments([sure, apart]) == set()
