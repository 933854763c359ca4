"""Rigid fits, joint transfer, and the way back from skeletons to poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.rotations import matrix_to_quat, rotvec_to_matrix
from depth_pose.core.skeleton import JOINT_NODES, NODE_INDEX
from depth_pose.paper.rigid import JointTransfer, fit_rigid
from depth_pose.refine.skeleton_pose import pose_from_skeleton
from skeletons import make_skeleton
from staged import pose_of, the_body


def fit_slowly(source, target, weights):
    """One transform, by the textbook."""
    mean_s = (weights[:, None] * source).sum(axis=0) / weights.sum()
    mean_t = (weights[:, None] * target).sum(axis=0) / weights.sum()
    covariance = sum(
        w * np.outer(t - mean_t, s - mean_s) for w, s, t in zip(weights, source, target, strict=True)
    )
    u, _, vt = np.linalg.svd(covariance)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return rotation, mean_t - rotation @ mean_s


def test_agrees_with_its_plain_twin() -> None:
    rng = np.random.default_rng(1)
    source, target, weights = rng.normal(size=(40, 3)), rng.normal(size=(40, 3)), rng.random((5, 40))
    found = fit_rigid(source, target, weights)
    for k in range(5):
        rotation, shift = fit_slowly(source, target, weights[k])
        np.testing.assert_allclose(found.rotation[k], rotation, atol=1e-9)
        np.testing.assert_allclose(found.translation[k], shift, atol=1e-9)


@pytest.mark.parametrize("flat", [1.0, 0.0])
def test_recovers_a_motion_and_never_mirrors(flat) -> None:
    rng = np.random.default_rng(2)
    source = rng.normal(size=(30, 3)) * (1, 1, flat)
    rotation, shift = rotvec_to_matrix(np.array([2.0, -1.0, 0.5])), np.array([1.0, 2.0, 3.0])
    found = fit_rigid(source, source @ rotation.T + shift, np.ones(30))
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(found.apply(np.ones(3)), rotation @ np.ones(3) + shift, atol=1e-9)
    mirrored = fit_rigid(source, source * (-1, 1, 1), np.ones(30))
    assert np.linalg.det(mirrored.rotation) == pytest.approx(1.0)


def test_joints_follow_a_rigid_motion_exactly() -> None:
    body = the_body()
    start = pose_of({"left_shoulder": (0, 0, 0.6), "right_knee": (0.5, 0, 0)})
    posed = body.pose(start.rotations, start.root)
    rotation, shift = rotvec_to_matrix(np.array([0.1, 0.6, -0.3])), np.array([0.5, -0.1, 0.4])
    nodes, rotations = JointTransfer(body).transfer(
        posed.vertices, posed.nodes, start.rotations, posed.vertices @ rotation.T + shift
    )
    np.testing.assert_allclose(nodes, posed.nodes @ rotation.T + shift, atol=1e-9)
    np.testing.assert_allclose(rotations, rotation @ start.rotations, atol=1e-9)


def test_joints_follow_a_change_of_pose() -> None:
    body = the_body()
    start = pose_of({})
    end = pose_of({"left_shoulder": (0, 0, 0.5), "left_elbow": (0, 0.3, 0.4), "right_hip": (0.4, 0, 0)})
    before, after = body.pose(start.rotations, start.root), body.pose(end.rotations, end.root)
    nodes, rotations = JointTransfer(body).transfer(
        before.vertices, before.nodes, start.rotations, after.vertices
    )
    assert np.linalg.norm(before.nodes - after.nodes, axis=1).max() > 0.2
    assert np.linalg.norm(nodes - after.nodes, axis=1).max() < 0.012
    turned = np.einsum("nij,nij->n", rotations, end.rotations)  # 1 + 2 cos of the angle between
    assert np.degrees(np.arccos(np.clip((turned - 1) / 2, -1, 1))).max() < 8


def test_pose_from_its_own_skeleton() -> None:
    body = the_body()
    pose = pose_of(
        {"pelvis": (0.1, 0.4, 0), "left_clavicle": (0, 0.1, 0.1), "left_shoulder": (0, 0.5, 0.6)}, scale=0.9
    )
    posed = body.pose(pose.rotations, pose.root, pose.scale)
    quats = matrix_to_quat(pose.rotations[JOINT_NODES])
    skeleton = make_skeleton(posed.nodes[JOINT_NODES], quats_xyzw=quats, scale=0.9)
    again = pose_from_skeleton(body, skeleton)
    rebuilt = body.pose(again.rotations, again.root, again.scale)
    assert np.linalg.norm(rebuilt.nodes - posed.nodes, axis=1).max() < 0.004  # the clavicles' roll is lost
    assert np.linalg.norm(rebuilt.vertices - posed.vertices, axis=1).max() < 0.02


def test_a_node_that_moves_no_vertex_turns_with_its_parent() -> None:
    """As of rigs without a neck's or a chest's bone."""
    body, chest = the_body(), NODE_INDEX["chest"]
    weights = body.weights.copy()
    weights[:, NODE_INDEX["spine"]] += weights[:, chest]
    weights[:, chest] = 0.0
    rig = replace(body, weights=weights)
    turn = rotvec_to_matrix(np.array([0.2, -0.4, 0.1]))
    posed = rig.pose(np.tile(turn, (len(rig.nodes), 1, 1)), np.array([0.3, 0.1, 2.0]))
    start = rig.pose(np.tile(np.eye(3), (len(rig.nodes), 1, 1)), np.zeros(3))
    eyes = np.tile(np.eye(3), (len(rig.nodes), 1, 1))
    nodes, rotations = JointTransfer(rig).transfer(start.vertices, start.nodes, eyes, posed.vertices)
    np.testing.assert_allclose(nodes, posed.nodes, atol=1e-6)
    np.testing.assert_allclose(rotations[chest], turn, atol=1e-6)
