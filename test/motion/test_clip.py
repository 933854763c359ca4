"""Sets of poses: mirrored, thinned, chosen."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.body.angles import (
    ANGLE_INDEX,
    ANGLES,
    ARM,
    LEG,
    N_ANGLES,
    rotations_from_angles,
    trunk_rotation,
)
from depth_pose.body.limits import clamp_angles
from depth_pose.core.skeleton import (
    mirror_rotations,
)
from depth_pose.motion.clip import (
    PoseSet,
    choose_for_coverage,
    heading,
    join_poses,
    joint_positions,
    mirror_joints,
    remove_near_duplicates,
    without_heading,
)
from depth_pose.motion.procedural.draw import swap_sides
from postures import some_angles


def test_equal_angles_are_a_symmetric_posture() -> None:
    angles = some_angles(np.random.default_rng(1), 20)
    angles[:, ARM[1]], angles[:, LEG[1]] = angles[:, ARM[0]], angles[:, LEG[0]]
    for name in ANGLES[:15]:
        if name.endswith(("side", "twist")):
            angles[:, ANGLE_INDEX[name]] = 0.0
    joints = joint_positions(rotations_from_angles(angles))
    np.testing.assert_allclose(joints, mirror_joints(joints), atol=1e-12)


def test_swapping_sides_mirrors_the_rotations() -> None:
    angles = some_angles(np.random.default_rng(2), 10)
    swapped = swap_sides(angles, np.array([True] * 5 + [False] * 5))
    rotations = rotations_from_angles(angles)
    np.testing.assert_allclose(
        rotations_from_angles(swapped)[:5], mirror_rotations(rotations)[:5], atol=1e-12
    )
    np.testing.assert_allclose(rotations_from_angles(swapped)[5:], rotations[5:])


def test_limits_are_the_same_for_both_sides() -> None:
    wild = np.random.default_rng(6).uniform(-200, 200, (50, N_ANGLES))
    rows = np.ones(50, bool)
    np.testing.assert_allclose(clamp_angles(swap_sides(wild, rows)), swap_sides(clamp_angles(wild), rows))


def test_headings_are_removed() -> None:
    angles = some_angles(np.random.default_rng(8), 20)
    rotations = rotations_from_angles(angles)
    turned = trunk_rotation(np.zeros(20), np.zeros(20), np.linspace(-170, 170, 20))[:, None] @ rotations
    np.testing.assert_allclose(heading(without_heading(turned)), 0.0, atol=1e-12)
    np.testing.assert_allclose(joint_positions(turned), joint_positions(rotations), atol=1e-12)


def pose_set(seed: int, count: int) -> PoseSet:
    angles = some_angles(np.random.default_rng(seed), count)
    return PoseSet(without_heading(rotations_from_angles(angles)), ("x",) * count)


def rms_distances(a: PoseSet, b: PoseSet) -> np.ndarray:
    p, q = joint_positions(a.rotations), joint_positions(b.rotations)
    return np.sqrt(((p[:, None] - q[None]) ** 2).sum(-1).mean(-1))


def test_near_duplicates_go_and_the_first_of_them_stays() -> None:
    poses = pose_set(9, 60)
    kept = remove_near_duplicates(join_poses(poses, poses, pose_set(10, 60)), 0.12)
    apart = rms_distances(kept, kept)
    assert apart[~np.eye(len(kept), dtype=bool)].min() >= 0.12 - 1e-4
    np.testing.assert_allclose(kept.rotations[0], poses.rotations[0])
    # Everything that went lies near something that stayed.
    assert rms_distances(poses, kept).min(axis=1).max() < 0.12


def test_chosen_poses_cover_better_than_any_others() -> None:
    poses = pose_set(14, 400)
    chosen = choose_for_coverage(poses, 40)
    assert len(set(chosen.tolist())) == 40
    far = rms_distances(poses, poses.take(chosen)).min(axis=1).max()
    by_chance = rms_distances(poses, poses.take(np.arange(40))).min(axis=1).max()
    assert far < by_chance
    assert len(choose_for_coverage(poses, 1000)) == 400


def test_a_pose_set_checks_its_families() -> None:
    with pytest.raises(ValueError, match="2 poses but 1"):
        PoseSet(np.tile(np.eye(3), (2, 21, 1, 1)), ("a",))
