"""Rotations and quaternions against scipy and their own axioms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from depth_pose.core.rotations import (
    R_CAMERA_FACING_MODEL,
    matrix_to_quat,
    mirror_rotation,
    nearest_rotation,
    quat_to_matrix,
    rotation_between,
    rotation_x,
    rotation_y,
    rotation_z,
    rotvec_to_matrix,
    unit_vectors,
)


def test_unit_vectors():
    vectors = np.array([[[3.0, 0.0, 4.0], [0.0, -2.0, 0.0]], [[1e-6, 0.0, 0.0], [0.0, 0.0, 0.0]]])
    wanted = [[[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]]
    np.testing.assert_allclose(unit_vectors(vectors), wanted, atol=1e-12)


@pytest.fixture
def rotations():
    """Random ones, and turns by half a circle and nearly so about every axis."""
    random = Rotation.random(200, random_state=0).as_matrix()
    axes = np.concatenate([np.eye(3), [[0.6, 0.8, 0.0], [0.5, -0.5, np.sqrt(0.5)]]])
    angles = np.array([0.0, 1e-9, 1e-4, np.pi - 1e-4, np.pi - 1e-9, np.pi])
    special = Rotation.from_rotvec((axes[:, None] * angles[:, None]).reshape(-1, 3)).as_matrix()
    return np.concatenate([random, special])


def test_round_trip(rotations):
    quats = matrix_to_quat(rotations)
    np.testing.assert_allclose(np.linalg.norm(quats, axis=-1), 1.0, atol=1e-12)
    assert (quats[:, 3] >= 0).all()
    np.testing.assert_allclose(quat_to_matrix(quats), rotations, atol=1e-9)


def test_against_scipy(rotations):
    theirs = Rotation.from_matrix(rotations).as_quat()
    ours = matrix_to_quat(rotations)
    np.testing.assert_allclose(np.abs(np.sum(theirs * ours, axis=1)), 1.0, atol=1e-9)
    np.testing.assert_allclose(quat_to_matrix(theirs), rotations, atol=1e-12)


def test_a_quaternion_and_its_negative_are_one_rotation():
    quat = matrix_to_quat(Rotation.random(random_state=1).as_matrix())
    np.testing.assert_allclose(quat_to_matrix(-quat), quat_to_matrix(quat))


def test_order_is_x_y_z_w():
    quarter = quat_to_matrix(np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]))
    np.testing.assert_allclose(quarter @ [1, 0, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize("shape", [(), (3,), (2, 4), (0,)])
def test_any_leading_shape(shape):
    vectors = np.random.default_rng(0).standard_normal((*shape, 3))
    matrices = rotvec_to_matrix(vectors)
    assert matrices.shape == (*shape, 3, 3)
    assert matrix_to_quat(matrices).shape == (*shape, 4)
    np.testing.assert_allclose(quat_to_matrix(matrix_to_quat(matrices)), matrices, atol=1e-12)


def test_rotation_vectors_against_scipy():
    rng = np.random.default_rng(2)
    vectors = np.concatenate(
        [rng.standard_normal((50, 3)) * 2, rng.standard_normal((20, 3)) * 1e-9, np.zeros((1, 3))]
    )
    np.testing.assert_allclose(
        rotvec_to_matrix(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-12
    )


def test_composition():
    a, b = Rotation.random(2, random_state=3).as_matrix()
    qa, qb = Rotation.from_matrix(a), Rotation.from_matrix(b)
    np.testing.assert_allclose(quat_to_matrix((qa * qb).as_quat()), a @ b, atol=1e-12)


@pytest.mark.parametrize(("turn", "axis"), [(rotation_x, 0), (rotation_y, 1), (rotation_z, 2)])
def test_turns_about_an_axis(turn, axis):
    angles = np.linspace(-3.0, 3.0, 7)
    np.testing.assert_allclose(turn(angles), rotvec_to_matrix(angles[:, None] * np.eye(3)[axis]), atol=1e-12)


def test_smallest_rotation_between_directions():
    a, b = np.random.default_rng(4).standard_normal((2, 50, 3))
    a, b = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (a, b))
    turn = rotation_between(a, b)
    np.testing.assert_allclose((turn @ a[..., None])[..., 0], b, atol=1e-12)
    angle = Rotation.from_matrix(turn).magnitude()
    np.testing.assert_allclose(np.cos(angle), (a * b).sum(axis=-1), atol=1e-12)


def test_nearest_rotation(rotations):
    np.testing.assert_allclose(nearest_rotation(1.7 * rotations), rotations, atol=1e-12)
    noisy = rotations + 0.05 * np.random.default_rng(5).standard_normal(rotations.shape)
    np.testing.assert_allclose(np.linalg.det(nearest_rotation(noisy)), 1.0, atol=1e-12)


def test_mirror_image(rotations):
    points = np.random.default_rng(6).standard_normal(3)
    flip = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(
        mirror_rotation(rotations) @ (flip * points), flip * (rotations @ points), atol=1e-12
    )


def test_who_faces_the_camera():
    """The head is up in the image, the face toward the camera, the left hand to its right."""
    assert (R_CAMERA_FACING_MODEL @ [0, 1, 0])[1] == -1
    assert (R_CAMERA_FACING_MODEL @ [0, 0, 1])[2] == -1
    assert (R_CAMERA_FACING_MODEL @ [1, 0, 0])[0] == 1
