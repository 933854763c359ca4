"""Angles, limits, contact, selection: the parts that every motion source shares."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.body.angles import (
    ANGLE_INDEX,
    ANGLES,
    ARM,
    FOREARM_M,
    LEG,
    N_ANGLES,
    UPPER_ARM_M,
    angles_from_rotations,
    rotations_from_angles,
    trunk_rotation,
)
from depth_pose.body.limits import HIGH, LOW, clamp_angles, clamp_rotations, violation, with_shoulder_rhythm
from depth_pose.core.skeleton import (
    ADULT_STATURE_M,
    NODE_INDEX,
    forward_kinematics,
    mirror_rotations,
    rest_nodes,
)
from depth_pose.motion._contact_kernels import _closest
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
from depth_pose.motion.contact import pelvis_height, separate_limbs, support_points, walk_on_floor
from depth_pose.motion.procedural.draw import swap_sides
from depth_pose.motion.reach import arm_to_target, leg_to_target

REST = rest_nodes() * ADULT_STATURE_M


def some_angles(rng: np.random.Generator, count: int) -> np.ndarray:
    angles = rng.uniform(-35, 35, (count, N_ANGLES))
    for name in ("elbow_flexion", "knee_flexion"):
        for side in ("left", "right"):
            angles[:, ANGLE_INDEX[f"{side}_{name}"]] = rng.uniform(0, 120, count)
    return angles


def nodes_of(angles: np.ndarray) -> np.ndarray:
    return forward_kinematics(rotations_from_angles(angles), np.zeros(3), REST)


def posture(**degrees: float) -> np.ndarray:
    angles = np.zeros(N_ANGLES)
    for name, value in degrees.items():
        angles[ANGLE_INDEX[name]] = value
    return angles


def test_angles_and_rotations_are_inverse() -> None:
    angles = some_angles(np.random.default_rng(0), 200)
    np.testing.assert_allclose(angles_from_rotations(rotations_from_angles(angles)), angles, atol=1e-9)


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


@pytest.mark.parametrize(
    ("angles", "start", "end", "direction"),
    [
        ({}, "left_shoulder", "left_wrist", (0, -1, 0)),
        ({"left_shoulder_flexion": 90}, "left_shoulder", "left_elbow", (0, 0, 1)),
        ({"left_shoulder_abduction": 90}, "left_shoulder", "left_elbow", (1, 0, 0)),
        ({"right_shoulder_abduction": 90}, "right_shoulder", "right_elbow", (-1, 0, 0)),
        ({"left_elbow_flexion": 90}, "left_elbow", "left_wrist", (0, 0, 1)),
        ({"left_elbow_flexion": 90, "left_shoulder_twist": 90}, "left_elbow", "left_wrist", (-1, 0, 0)),
        ({"right_elbow_flexion": 90, "right_shoulder_twist": 90}, "right_elbow", "right_wrist", (1, 0, 0)),
        ({"left_hip_flexion": 90}, "left_hip", "left_knee", (0, 0, 1)),
        ({"left_knee_flexion": 90}, "left_knee", "left_ankle", (0, 0, -1)),
        ({"right_hip_abduction": 30}, "right_hip", "right_knee", (-0.5, -np.sqrt(0.75), 0)),
    ],
)
def test_anatomical_angles_mean_what_they_say(angles, start, end, direction) -> None:
    at = nodes_of(posture(**angles))
    bone = at[NODE_INDEX[end]] - at[NODE_INDEX[start]]
    np.testing.assert_allclose(bone / np.linalg.norm(bone), direction, atol=1e-9)


def test_trunk_angles_mean_what_they_say() -> None:
    np.testing.assert_allclose(trunk_rotation(90.0, 0.0, 0.0) @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(trunk_rotation(0.0, 90.0, 0.0) @ [0, 1, 0], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(trunk_rotation(0.0, 0.0, 90.0) @ [0, 0, 1], [1, 0, 0], atol=1e-12)


def test_arm_reaches_its_target_with_the_elbow_toward_the_pole() -> None:
    rng = np.random.default_rng(3)
    direction = rng.normal(size=(100, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    target = direction * rng.uniform(0.1, 0.98 * (UPPER_ARM_M + FOREARM_M), (100, 1))
    pole = np.array([0.6, -0.6, -0.3])
    angles = np.zeros((100, N_ANGLES))
    angles[:, ARM[0]] = arm_to_target(target, pole)
    at = nodes_of(angles)
    shoulder, elbow, wrist = (at[:, NODE_INDEX[f"left_{n}"]] for n in ("shoulder", "elbow", "wrist"))
    np.testing.assert_allclose(wrist - shoulder, target, atol=1e-6)
    away = elbow - shoulder - np.sum((elbow - shoulder) * direction, axis=1, keepdims=True) * direction
    assert (away @ pole > -1e-9).all()


def test_leg_reaches_its_target_with_the_foot_flat() -> None:
    rng = np.random.default_rng(4)
    pelvis = trunk_rotation(10.0, 4.0, 12.0)
    ankle = rng.uniform((-0.1, -0.83, -0.15), (0.15, -0.45, 0.15), (100, 3))
    angles = np.zeros((100, N_ANGLES))
    angles[:, :3] = 10.0, 4.0, 12.0
    angles[:, LEG[0]] = leg_to_target(ankle, np.full(100, 8.0), np.zeros(100), pelvis)
    rotations = rotations_from_angles(angles)
    at = forward_kinematics(rotations, np.zeros(3), REST)
    np.testing.assert_allclose(
        at[:, NODE_INDEX["left_ankle"]] - at[:, NODE_INDEX["left_hip"]], ankle, atol=1e-6
    )
    np.testing.assert_allclose(rotations[:, NODE_INDEX["left_foot"], 1, 1], 1.0, atol=1e-9)


def test_clamping_brings_everything_inside_and_keeps_what_is_inside() -> None:
    rng = np.random.default_rng(5)
    wild = rng.uniform(-200, 200, (300, N_ANGLES))
    tame = clamp_angles(wild)
    assert violation(wild).max() > 50
    np.testing.assert_allclose(violation(tame), 0.0, atol=1e-9)
    # Arms that point up are free in their plane and twist; everything else is within its range.
    free = [
        ANGLE_INDEX[f"{s}_shoulder_{n}"] for s in ("left", "right") for n in ("flexion", "abduction", "twist")
    ]
    bound = np.setdiff1d(np.arange(N_ANGLES), free)
    assert (tame >= LOW - 1e-9)[:, bound].all() and (tame <= HIGH + 1e-9)[:, bound].all()
    assert np.linalg.norm(tame[:, free[:2]], axis=1).max() < 180 + 1e-9
    np.testing.assert_allclose(clamp_angles(tame), tame, atol=1e-9)


def test_limits_are_the_same_for_both_sides() -> None:
    wild = np.random.default_rng(6).uniform(-200, 200, (50, N_ANGLES))
    rows = np.ones(50, bool)
    np.testing.assert_allclose(clamp_angles(swap_sides(wild, rows)), swap_sides(clamp_angles(wild), rows))


def test_an_elbow_does_not_bend_backward_nor_a_knee_forward() -> None:
    broken = rotations_from_angles(posture(left_elbow_flexion=-40, right_knee_flexion=-30))
    mended = angles_from_rotations(clamp_rotations(broken))
    assert mended[ANGLE_INDEX["left_elbow_flexion"]] == pytest.approx(0, abs=1e-6)
    assert mended[ANGLE_INDEX["right_knee_flexion"]] == pytest.approx(0, abs=1e-6)


def test_the_shoulder_rises_with_the_arm_beyond_thirty_degrees() -> None:
    def elevation(abduction: float) -> float:
        angles = with_shoulder_rhythm(posture(left_shoulder_abduction=abduction))
        return float(angles[ANGLE_INDEX["left_clavicle_elevation"]])

    assert elevation(20) == elevation(30) == 0.0
    assert elevation(150) - elevation(90) == pytest.approx(10.0)


def test_standing_feet_rest_on_the_floor() -> None:
    rest = np.tile(np.eye(3), (21, 1, 1))
    assert pelvis_height(rest) == pytest.approx(REST[0, 1])
    assert support_points(rest)[:, 1].min() == pytest.approx(-REST[0, 1])


def test_arms_are_pushed_out_of_the_body() -> None:
    inside = np.stack(
        [
            posture(left_shoulder_abduction=-25, left_elbow_flexion=20),
            posture(right_shoulder_flexion=20, right_shoulder_twist=80, right_elbow_flexion=90),
            posture(left_hip_abduction=-20, right_hip_abduction=-20),
            posture(left_shoulder_abduction=90, right_shoulder_abduction=20),
        ]
    )
    rotations = rotations_from_angles(inside)
    before = separate_limbs(rotations, rounds=1).depth
    after = separate_limbs(rotations)
    assert (before[:3] > 0.01).all() and before[3] == 0.0
    assert (after.depth < 0.003).all()
    assert separate_limbs(after.rotations, rounds=1).depth.max() < 0.004
    np.testing.assert_allclose(after.rotations[3], rotations[3])
    np.testing.assert_allclose(np.linalg.det(after.rotations), 1.0)


def test_closest_points_against_a_fine_grid() -> None:
    rng = np.random.default_rng(7)
    grid = np.linspace(0, 1, 401)
    for _ in range(30):
        a, b, c, d = rng.normal(size=(4, 3))
        s, t = _closest(a, b, c, d)
        found = np.linalg.norm(a + s * (b - a) - c - t * (d - c))
        p, q = a + grid[:, None] * (b - a), c + grid[:, None] * (d - c)
        best = np.linalg.norm(p[:, None] - q[None], axis=-1).min()
        assert found <= best + 1e-9 and best - found < 0.02


def test_the_foot_on_the_floor_stays_where_it_is() -> None:
    t = np.linspace(0, 1, 31)
    angles = np.zeros((31, N_ANGLES))
    # The right leg is lifted; the body sways over the left one.
    angles[:, ANGLE_INDEX["right_hip_flexion"]], angles[:, ANGLE_INDEX["right_knee_flexion"]] = 40, 60
    angles[:, ANGLE_INDEX["left_hip_flexion"]] = 20 * t
    angles[:, ANGLE_INDEX["left_ankle_dorsiflexion"]] = -20 * t
    rotations = rotations_from_angles(angles)
    roots = walk_on_floor(rotations, np.zeros(31))
    heel = (support_points(rotations) + roots[:, None])[:, 0]
    assert np.ptp(heel[:, [0, 2]], axis=0).max() < 0.01
    assert np.ptp(roots[:, 2]) > 0.1


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
