"""The paper's refinement of one candidate, and carrying a body from frame to frame."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.body.rendered_depth import Observation
from depth_pose.core.camera import Camera
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.paper.coherence import geodesic_basis, surface_distances
from depth_pose.paper.completion import MeshCompleter
from depth_pose.recover.temporal import CloudTracker
from depth_pose.track.person_view import thin
from staged import person_of, pose_of, the_body

TRUTH = {"left_shoulder": (0, 0, -0.35), "left_elbow": (0, 0, -0.3), "right_hip": (0, 0, 0.15)}
START = {"left_shoulder": (0, 0, -0.2), "left_elbow": (0, 0, -0.1)}


@pytest.fixture(scope="module")
def completer() -> MeshCompleter:
    return MeshCompleter(the_body())


def view_of(pose):
    posed = the_body().pose(pose.rotations, pose.root, pose.scale)
    return person_of(posed.vertices), posed


def error(nodes, posed) -> float:
    return float(np.linalg.norm(nodes[JOINT_NODES] - posed.nodes[JOINT_NODES], axis=1).mean())


def test_brings_a_near_exemplar_to_the_input(completer) -> None:
    view, truth = view_of(pose_of(TRUTH))
    start = pose_of(START, root=(0.04, 0.02, 3.05))
    posed = the_body().pose(start.rotations, start.root)
    found = completer.fit(thin(view.points, 600), view.coarse, start)
    assert error(posed.nodes, truth) > 0.06
    assert error(found.nodes, truth) < 0.025
    hidden = completer.visible(truth, pose_of(TRUTH).rotations, view.coarse) <= 0
    assert np.linalg.norm(found.vertices - truth.vertices, axis=1)[hidden].mean() < 0.04


def test_turns_with_the_camera(completer) -> None:
    view, _ = view_of(pose_of(TRUTH))
    points, start, c = thin(view.points, 600), pose_of(START, root=(0.04, 0.02, 3.05)), view.coarse.camera
    here = completer.fit(points, view.coarse, start)
    roll = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # a quarter turn maps pixels onto pixels
    turned = Observation(
        np.ascontiguousarray(view.coarse.depth.T[:, ::-1]),
        np.ascontiguousarray(view.coarse.labels.T[:, ::-1]),
        Camera(c.height, c.width, c.fy, c.fx, c.height - 1 - c.cy, c.cx),
    )
    there = completer.fit(
        points @ roll.T, turned, type(start)(roll @ start.rotations, roll @ start.root, 1.0)
    )
    np.testing.assert_allclose(there.nodes, here.nodes @ roll.T, atol=2e-4)
    np.testing.assert_allclose(there.pose.rotations, roll @ here.pose.rotations, atol=5e-3)


def test_completion_turns_with_its_correspondences(completer) -> None:
    body, rng, start = the_body(), np.random.default_rng(3), pose_of(START)
    posed = body.pose(start.rotations, start.root)
    weights = np.where(rng.random(len(body.vertices)) < 0.3, 0.1, 0.0)
    targets = posed.vertices + rng.normal(size=posed.vertices.shape) * 0.02
    here = completer.complete(start, posed, targets, weights)
    rotation, shift = rotvec_to_matrix(np.array([0.3, 0.8, -0.2])), np.array([0.3, 0.1, 1.0])
    turned = type(start)(rotation @ start.rotations, rotation @ start.root + shift, 1.0)
    there = completer.complete(
        turned, body.pose(turned.rotations, turned.root), targets @ rotation.T + shift, weights
    )
    np.testing.assert_allclose(there.vertices, here.vertices @ rotation.T + shift, atol=1e-8)
    np.testing.assert_allclose(there.nodes, here.nodes @ rotation.T + shift, atol=1e-8)
    np.testing.assert_allclose(there.pose.rotations, rotation @ here.pose.rotations, atol=1e-8)


def test_leaves_the_exemplar_where_nothing_is_visible(completer) -> None:
    view, _ = view_of(pose_of(TRUTH))
    behind = pose_of(START, root=(0, 0, -3.0))
    found = completer.fit(thin(view.points, 600), view.coarse, behind)
    np.testing.assert_allclose(found.nodes, the_body().pose(behind.rotations, behind.root).nodes, atol=1e-12)


def test_carries_a_body_to_the_next_frame(completer) -> None:
    before = pose_of(START)
    after = pose_of({**START, "left_shoulder": (0, 0, -0.3)}, root=(0.03, 0.0, 3.02))
    view_before, _ = view_of(before)
    view_after, truth = view_of(after)
    carried = CloudTracker(completer).carry_body(
        thin(view_before.points, 600), thin(view_after.points, 600), view_before.coarse, before, the_body()
    )
    assert error(the_body().pose(before.rotations, before.root).nodes, truth) > 0.03
    assert error(carried.nodes, truth) < 0.015


def test_distances_run_along_the_surface() -> None:
    body = the_body()
    hand = int(np.argmax(body.vertices[:, 0]))
    other = int(np.argmin(body.vertices[:, 0]))
    distances = surface_distances(body.vertices, body.faces, np.array([hand]))[:, 0]
    straight = np.linalg.norm(body.vertices - body.vertices[hand], axis=1)
    assert distances[hand] == 0
    assert (distances >= straight - 1e-9).all()
    foot = int(np.argmin(body.vertices[:, 1] - body.vertices[:, 0]))
    assert distances[foot] > 1.25 * straight[foot]
    assert distances[other] > straight[other]


def test_surface_distances_of_a_flat_grid() -> None:
    i, j = np.meshgrid(np.arange(9), np.arange(9), indexing="ij")
    vertices = np.stack([i.ravel(), j.ravel(), 0 * i.ravel()], axis=1).astype(float)
    a = (9 * i + j)[:-1, :-1].ravel()
    faces = np.concatenate([np.stack([a, a + 9, a + 1], 1), np.stack([a + 1, a + 9, a + 10], 1)])
    distances = surface_distances(vertices, faces, np.array([0]))[:, 0]
    exact = np.linalg.norm(vertices, axis=1)
    assert (distances / np.maximum(exact, 1e-9))[1:].max() < 1.12
    assert distances[80] == pytest.approx(exact[80])  # the diagonals across edges count


def test_one_basis_serves_the_body() -> None:
    body = the_body()
    basis = geodesic_basis(body.vertices, body.faces, 60, 0.7)
    assert basis.shape[0] == len(body.vertices)
    assert basis.shape[1] <= 60
    norms = (basis**2).sum(axis=1)  # the kernel's diagonal, 1 where the approximation is exact
    assert np.median(np.abs(norms - 1)) < 0.05
