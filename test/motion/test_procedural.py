"""The procedural motion source: every family, as clips and as poses."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.body.angles import ANGLE_INDEX, angles_from_rotations, rotations_from_angles
from depth_pose.body.limits import violation
from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import NODE_INDEX
from depth_pose.motion.clip import heading, joint_positions, mirror_joints
from depth_pose.motion.contact import separate_limbs, support_points, walk_on_floor
from depth_pose.motion.procedural.draw import Draw, harmonic, keyed
from depth_pose.motion.procedural.families import FAMILIES
from depth_pose.motion.procedural.gait import WALK_KNEE, gait_legs
from depth_pose.motion.procedural.generator import CLIPS, STAY_WITHIN_M, make_clip, make_poses


@pytest.fixture(scope="module")
def poses():
    return make_poses(600, seed=3)


@pytest.mark.parametrize("name", sorted(CLIPS))
def test_every_clip_is_a_person_moving(name: str) -> None:
    clip = CLIPS[name](fps=25.0, seconds=4.0, seed=5)
    assert clip.rotations.shape == (100, 21, 3, 3) and clip.roots.shape == (100, 3)
    np.testing.assert_allclose(np.linalg.det(clip.rotations), 1.0, atol=1e-9)
    lowest = (support_points(clip.rotations) + clip.roots[:, None])[..., 1].min(axis=1)
    assert lowest.min() > -1e-6, "feet through the floor"
    assert np.sort(lowest)[50] < 0.15, "floats"
    nodes = clip.nodes()
    speed = np.linalg.norm(np.diff(nodes, axis=0), axis=-1) * 25
    assert speed.max() < 14.0 and speed.max() > 0.02
    assert np.linalg.norm(clip.roots[:, [0, 2]], axis=1).max() < 4 * STAY_WITHIN_M
    assert np.percentile(violation(angles_from_rotations(clip.rotations)).max(axis=1), 90) < 20
    assert np.mean(separate_limbs(clip.rotations, rounds=1).depth > 0.03) < 0.1, "limbs inside the body"


def test_the_seed_decides() -> None:
    one, same, other = (make_clip("wave", 20.0, 2.0, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.rotations, same.rotations)
    assert np.abs(one.rotations - other.rotations).max() > 0.1


def test_the_frame_rate_does_not_change_the_motion() -> None:
    slow, fast = make_clip("walk", 30.0, 3.0, seed=8), make_clip("walk", 60.0, 3.0, seed=8)
    a, b = slow.nodes() - slow.roots[:, None], (fast.nodes() - fast.roots[:, None])[::2]
    assert np.linalg.norm(a - b, axis=-1)[10:-10].mean() < 0.01


def test_unknown_names_and_lengths_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"unknown motion 'fly'; there are: .*walk"):
        make_clip("fly")
    with pytest.raises(ConfigError, match="positive"):
        make_clip("walk", fps=0.0)
    with pytest.raises(ConfigError, match="at least 2"):
        make_poses(1)


def test_walking_steps_alternate_and_swing_the_knee() -> None:
    draw = Draw(np.random.default_rng(0), ())
    phase = np.linspace(0, 2, 200, endpoint=False)
    _, legs = gait_legs(phase, draw, np.array(1.0))
    left, right = legs[:, 3], legs[:, 10]
    assert 50 < left.max() < 95 and left.min() >= 0
    np.testing.assert_allclose(left - left.mean(), np.roll(right - right.mean(), -50), atol=6)
    # Published curve: the knee bends most at about 70 % of the cycle.
    assert 0.66 < phase[np.argmax(harmonic(phase, WALK_KNEE)[:100])] < 0.78


@pytest.mark.parametrize(("name", "low", "high"), [("walk", 0.35, 2.2), ("run", 1.0, 6.0)])
def test_steps_carry_the_body_forward(name: str, low: float, high: float) -> None:
    for seed in range(4):
        draw = Draw(np.random.default_rng(seed), ())
        t = np.arange(60) / 30.0
        motion = FAMILIES[name].motion(t, draw)
        rotations = rotations_from_angles(motion.angles)
        velocity = np.diff(walk_on_floor(rotations, motion.lift), axis=0) * 30
        facing = heading(rotations[1:])
        forward = velocity[:, 0] * np.sin(facing) + velocity[:, 2] * np.cos(facing)
        assert low < forward.mean() < high
        assert np.mean(forward < -0.5) < 0.05, "the swinging foot drags the body back"


def test_series_and_keys_go_through_their_points() -> None:
    curve = harmonic(np.array([0.0, 0.5]), ((0, 10), (25, 0), (50, -10), (75, 0)))
    np.testing.assert_allclose(curve, [10, -10], atol=0.5)
    table = ((0.0, {"head_twist": 5.0}), (0.5, {"head_twist": 20.0}), (1.0, {}))
    np.testing.assert_allclose(
        keyed(np.array([0.0, 0.5, 1.0]), table)[:, ANGLE_INDEX["head_twist"]], [5, 20, 20]
    )


def test_poses_face_forward_and_come_with_their_mirror_images(poses) -> None:
    assert len(poses) == len(poses.families) == 600
    np.testing.assert_allclose(heading(poses.rotations), 0.0, atol=1e-9)
    joints = joint_positions(poses.rotations)
    np.testing.assert_allclose(joints[300:], mirror_joints(joints[:300]), atol=1e-9)
    assert poses.families[:300] == poses.families[300:]
    assert len(set(poses.families)) > 15


def test_poses_are_possible(poses) -> None:
    assert separate_limbs(poses.rotations, rounds=1).depth.max() < 0.05
    assert np.percentile(violation(angles_from_rotations(poses.rotations)).max(axis=1), 95) < 15


def test_poses_reach_everywhere(poses) -> None:
    """Wrists come to every octant about the shoulder that an arm can reach, knees high and low."""
    joints = joint_positions(poses.rotations)
    reach = joints[:, 7] - joints[:, 5]
    octants = (reach > 0) @ [1, 2, 4]
    assert len(np.unique(octants)) == 8
    assert reach[:, 1].max() > 0.45 and reach[:, 2].max() > 0.45 and reach[:, 0].max() > 0.45
    knees = joints[:, 12] - joints[:, 11]
    assert knees[:, 1].max() > -0.1


def test_poses_are_reproducible(poses) -> None:
    again = make_poses(600, seed=3)
    np.testing.assert_array_equal(poses.rotations, again.rotations)
    assert poses.families == again.families


def test_hands_reach_the_hips_and_the_head() -> None:
    clip = make_clip("crossed_arms", 10.0, 30.0, seed=1)
    at = clip.nodes()
    wrists = at[:, [NODE_INDEX["left_wrist"], NODE_INDEX["right_wrist"]]]
    assert np.isfinite(wrists).all()
    assert np.linalg.norm(wrists[:, 0] - wrists[:, 1], axis=-1).min() < 0.45
