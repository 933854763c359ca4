"""Laplacian completion: known answers, the plain solution, and what it must not depend on."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core.errors import InputError
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.paper.laplacian import LaplacianCompleter, cotangent_laplacian
from staged import the_body


def octahedron() -> tuple[np.ndarray, np.ndarray]:
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    return vertices, np.array(faces)


def test_cotangents_of_equilateral_triangles() -> None:
    laplacian = cotangent_laplacian(*octahedron()).toarray()
    cotangent = 1 / np.sqrt(3)  # of 60 degrees, half of it from each of an edge's two faces
    expected = 4 * cotangent * np.eye(6)
    for i in range(6):
        for j in range(6):
            if i != j and (i - j) % 3 != 0:
                expected[i, j] = -cotangent
    np.testing.assert_allclose(laplacian, expected, atol=1e-12)


def test_a_right_triangle() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    laplacian = cotangent_laplacian(vertices, np.array([[0, 1, 2]])).toarray()
    np.testing.assert_allclose(laplacian, [[1, -0.5, -0.5], [-0.5, 0.5, 0], [-0.5, 0, 0.5]], atol=1e-12)


def test_solves_equation_7() -> None:
    body, rng = the_body(), np.random.default_rng(1)
    n = len(body.vertices)
    weights = np.where(rng.random(n) < 0.3, rng.uniform(0.05, 0.5, n), 0.0)
    posed = body.vertices @ rotvec_to_matrix(np.array([0.2, 1.0, -0.4])).T
    targets = posed + rng.normal(size=(n, 3)) * 0.02
    result = LaplacianCompleter(body.vertices, body.faces).complete(posed, targets, weights)
    laplacian = cotangent_laplacian(body.vertices, body.faces).toarray()
    square = laplacian.T @ laplacian
    plain = np.linalg.solve(square + np.diag(weights), square @ posed + weights[:, None] * targets)
    np.testing.assert_allclose(result, plain, atol=1e-5)


def test_carries_the_whole_by_a_shift_of_a_part() -> None:
    body = the_body()
    weights = np.where(body.vertices[:, 2] > 0.05, 0.1, 0.0)
    shift = np.array([0.1, -0.2, 0.3])
    result = LaplacianCompleter(body.vertices, body.faces).complete(
        body.vertices, body.vertices + shift, weights
    )
    np.testing.assert_allclose(result, body.vertices + shift, atol=1e-4)


def test_leaves_a_mesh_without_correspondences() -> None:
    body = the_body()
    nothing = np.zeros(len(body.vertices))
    result = LaplacianCompleter(body.vertices, body.faces).complete(body.vertices, body.vertices + 1, nothing)
    np.testing.assert_array_equal(result, body.vertices)


def test_turns_with_its_input() -> None:
    body, rng = the_body(), np.random.default_rng(2)
    completer = LaplacianCompleter(body.vertices, body.faces)
    weights = np.where(rng.random(len(body.vertices)) < 0.2, 0.1, 0.0)
    targets = body.vertices + rng.normal(size=body.vertices.shape) * 0.03
    rotation, shift = rotvec_to_matrix(np.array([1.0, 0.3, -0.7])), np.array([2.0, 1.0, -3.0])
    here = completer.complete(body.vertices, targets, weights)
    there = completer.complete(body.vertices @ rotation.T + shift, targets @ rotation.T + shift, weights)
    np.testing.assert_allclose(there, here @ rotation.T + shift, atol=1e-9)


def test_refuses_what_does_not_belong_together() -> None:
    body = the_body()
    with pytest.raises(InputError, match="vertices"):
        LaplacianCompleter(body.vertices, body.faces).complete(
            body.vertices[:-1], body.vertices[:-1], np.zeros(len(body.vertices) - 1)
        )
    with pytest.raises(InputError, match="face 0"):
        cotangent_laplacian(np.zeros((3, 3)), np.array([[0, 1, 2]]))
