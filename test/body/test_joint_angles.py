"""Joint angles of postures whose angles are known."""

from __future__ import annotations

import numpy as np
import pytest

import depth_pose
from depth_pose.body.angle_definitions import AGAINST_VERTICAL, JOINT_ANGLES
from depth_pose.body.angles import rotations_from_angles
from depth_pose.body.joint_angles import joint_angles, joint_covariances, measure_angles
from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, matrix_to_quat, rotvec_to_matrix
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, JointState
from postures import nodes_of, posture
from skeletons import make_skeleton

UP = np.array([0.0, 1.0, 0.0])


def person(**angles):
    """A skeleton of a posture in the model frame."""
    degrees = posture(**angles)
    rotations = rotations_from_angles(degrees)
    return make_skeleton(nodes_of(degrees)[JOINT_NODES], quats_xyzw=matrix_to_quat(rotations[JOINT_NODES]))


def test_standing_is_zero() -> None:
    for angle in joint_angles(person(), UP):
        if not angle.name.endswith(("_rotation", "_plane")) or angle.name == "trunk_rotation":
            assert angle.degrees == pytest.approx(0.0, abs=3.0), angle
            assert 0.5 < angle.deviation < 15.0, angle


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"hip_flexion": 60}, {"hip_flexion": 60, "hip_abduction": 0, "knee_flexion": 0}),
        ({"hip_abduction": 30}, {"hip_abduction": 30, "hip_flexion": 0}),
        ({"hip_flexion": -15}, {"hip_flexion": -15}),
        ({"knee_flexion": 70}, {"knee_flexion": 70, "hip_flexion": 0, "hip_rotation": 0}),
        ({"hip_flexion": 80, "knee_flexion": 90, "hip_twist": 25}, {"hip_rotation": 25, "knee_flexion": 90}),
        ({"ankle_dorsiflexion": 15}, {"ankle_dorsiflexion": 15}),
        ({"ankle_dorsiflexion": -20, "ankle_toe_out": 15}, {"ankle_dorsiflexion": -20}),
        ({"shoulder_flexion": 90}, {"shoulder_elevation": 90, "shoulder_plane": 90}),
        ({"shoulder_abduction": 70}, {"shoulder_elevation": 70, "shoulder_plane": 0}),
        ({"elbow_flexion": 80}, {"elbow_flexion": 80, "shoulder_rotation": 0}),
        ({"elbow_flexion": 90, "shoulder_twist": 40}, {"elbow_flexion": 90, "shoulder_rotation": 40}),
    ],
)
def test_limbs(side, given, expected) -> None:
    angles = joint_angles(person(**{f"{side}_{name}": value for name, value in given.items()}), UP)
    for name, value in expected.items():
        assert angles[f"{side}_{name}"].degrees == pytest.approx(value, abs=2.5), name


def test_trunk_and_pelvis() -> None:
    bent = joint_angles(person(pelvis_flexion=30), UP)
    assert bent["trunk_flexion"].degrees == pytest.approx(30, abs=2.5)
    assert bent["pelvis_tilt"].degrees == pytest.approx(30, abs=0.1)
    assert joint_angles(person(pelvis_side=20), UP)["trunk_side"].degrees == pytest.approx(20, abs=1)
    assert joint_angles(person(pelvis_side=-10), UP)["pelvis_obliquity"].degrees == pytest.approx(10, abs=1)
    assert joint_angles(person(chest_twist=25), UP)["trunk_rotation"].degrees == pytest.approx(25, abs=1)


def test_angles_do_not_depend_on_the_frame() -> None:
    """A rigid motion of the skeleton, and of up with it, changes nothing."""
    one = person(left_hip_flexion=40, left_knee_flexion=60, pelvis_flexion=20, right_elbow_flexion=70)
    turn = rotvec_to_matrix(np.array([0.4, -1.1, 0.6])) @ R_CAMERA_FACING_MODEL
    degrees = []
    for R in (np.eye(3), turn):
        positions = one.positions @ R.T + 3.0 * R[:, 0]
        own = rotations_from_angles(
            posture(left_hip_flexion=40, left_knee_flexion=60, pelvis_flexion=20, right_elbow_flexion=70)
        )
        moved = make_skeleton(positions, quats_xyzw=matrix_to_quat(R @ own[JOINT_NODES]))
        degrees.append(joint_angles(moved, R @ UP).degrees)
    np.testing.assert_allclose(degrees[0], degrees[1], atol=1e-6)


def test_rotation_of_a_straight_limb_is_not_measured() -> None:
    straight, bent = (
        joint_angles(person(), UP),
        joint_angles(person(left_elbow_flexion=80, left_knee_flexion=60), UP),
    )
    for name in ("left_shoulder_rotation", "left_hip_rotation", "left_shoulder_plane"):
        assert not straight[name].measured
        assert np.isnan(straight[name].degrees) and np.isinf(straight[name].deviation)
    assert bent["left_shoulder_rotation"].measured and bent["left_hip_rotation"].measured
    assert straight.to_dict()["left_hip_rotation"] == {"degrees": None, "deviation": None}


def test_without_up_nothing_is_said_against_the_vertical() -> None:
    angles = joint_angles(person(pelvis_flexion=30))
    assert {a.name for a in angles if not a.measured} >= set(AGAINST_VERTICAL)
    assert angles["left_knee_flexion"].measured


def test_deviations_are_those_of_many_draws() -> None:
    """Of joints that are moved at random, as their covariances say."""
    one = person(left_hip_flexion=30, left_knee_flexion=50, left_shoulder_flexion=40, left_elbow_flexion=60)
    covariances = joint_covariances(one.joint_confidence)
    _, stated = measure_angles(
        one.positions, one.quats_xyzw, one.joint_confidence, one.joint_states, None, UP
    )
    rng = np.random.default_rng(0)
    sigma = np.sqrt(covariances[:, 0, 0])[:, None]
    drawn = one.positions + sigma * rng.normal(size=(4000, 19, 3))
    quats = np.broadcast_to(one.quats_xyzw, (4000, 19, 4))
    sure, seen = np.ones((4000, 19)), np.zeros((4000, 19), np.uint8)
    spread = np.nanstd(measure_angles(drawn, quats, sure, seen, None, UP)[0], axis=0)
    for name in ("left_knee_flexion", "left_elbow_flexion", "left_ankle_dorsiflexion", "trunk_flexion"):
        i = JOINT_ANGLES.index(name)
        assert stated[i] == pytest.approx(spread[i], rel=0.15), name


def test_doubt_about_a_joint_is_doubt_about_its_angles() -> None:
    one = person(left_elbow_flexion=60, right_elbow_flexion=60)
    confidence = np.ones(19, np.float32)
    confidence[JOINT_INDEX["left_wrist"]] = 0.4
    angles = joint_angles(
        make_skeleton(one.positions, quats_xyzw=one.quats_xyzw, joint_confidence=confidence), UP
    )
    assert not angles["left_elbow_flexion"].measured
    assert angles["right_elbow_flexion"].deviation < 8


def test_angles_of_joints_outside_the_image_are_not_measured() -> None:
    """However sure the guess: the ankles of somebody who stands too near."""
    one = person(left_hip_flexion=30, left_knee_flexion=50, right_knee_flexion=50)
    states = np.full(19, JointState.SEEN, np.uint8)
    states[JOINT_INDEX["left_ankle"]] = JointState.OUTSIDE_IMAGE
    angles = joint_angles(make_skeleton(one.positions, quats_xyzw=one.quats_xyzw, joint_states=states), UP)
    assert not any(angles[f"left_{name}"].measured for name in ("knee_flexion", "ankle_dorsiflexion"))
    for name in ("left_hip_flexion", "right_knee_flexion", "right_ankle_dorsiflexion", "trunk_flexion"):
        assert angles[name] == joint_angles(one, UP)[name], name


def test_wrong_input_is_refused() -> None:
    with pytest.raises(InputError, match="LOST"):
        depth_pose.joint_angles(Skeleton.lost(1, "camera"))
    with pytest.raises(InputError, match="three numbers"):
        depth_pose.joint_angles(person(), up=[0.0, 1.0])
    with pytest.raises(KeyError, match="left_knee_flexion"):
        depth_pose.joint_angles(person())["left_knee"]


def test_doubt_that_all_joints_share_is_no_doubt_about_angles() -> None:
    """Carried covariances: depth of the whole body is unsure; then also the left wrist."""
    one = person(left_elbow_flexion=60, right_elbow_flexion=60)
    shared = np.tile(np.diag([1e-4, 1e-4, 4e-4]), (19, 1, 1))
    own = shared.copy()
    own[JOINT_INDEX["left_wrist"]] += 0.04**2 * np.eye(3)
    values = {"quats_xyzw": one.quats_xyzw}
    alike, doubtful = (
        joint_angles(make_skeleton(one.positions, covariances=c, **values), UP) for c in (shared, own)
    )
    np.testing.assert_allclose(alike.deviations, joint_angles(one, UP).deviations, rtol=1e-6)
    assert doubtful["left_elbow_flexion"].deviation > 1.5 * alike["left_elbow_flexion"].deviation
    assert doubtful["right_elbow_flexion"].deviation == pytest.approx(alike["right_elbow_flexion"].deviation)
