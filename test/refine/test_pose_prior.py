"""The pose prior: what people seldom do is unusual, wherever they stand and whichever way they face."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.skeleton import JOINT_NODES, MIRROR_JOINTS, forward_kinematics
from depth_pose.refine import _plausible_kernels as kernels
from depth_pose.refine.pose_prior import PosePrior, usual_joints


@pytest.fixture(scope="module")
def prior(bank):
    return PosePrior(usual_joints(bank))


def _nodes(body, rotations, turn=None, root=(0.0, 0.0, 3.0), scale=1.0):
    turn = syn.FACING if turn is None else turn
    return forward_kinematics(turn @ rotations, np.array(root), body.nodes, scale)


def test_standing_is_usual_and_a_leg_up_the_back_is_not(body, prior):
    standing = _nodes(body, syn.arms_down())
    turned = syn.upright(
        left_shoulder=syn.rotation("z", -38.0),
        right_shoulder=syn.rotation("z", 38.0),
        left_hip=syn.rotation("x", 150.0),
    )
    at_ease, strained = (
        kernels.excess(nodes[JOINT_NODES], 1.0, prior.mean, prior.whiten)
        for nodes in (standing, _nodes(body, turned))
    )
    assert at_ease == 0.0
    assert strained > 0.2


def test_place_heading_and_size_do_not_matter(body, bank, prior):
    for number in range(0, bank.poses, 60):
        rotations = bank.rotations(number)
        here = prior.distance(_nodes(body, rotations), 1.0)
        turn = syn.rotation("y", 70.0) @ syn.rotation("x", 20.0)
        there = prior.distance(_nodes(body, rotations, turn, (1.0, -0.4, 2.0), 0.8), 0.8)
        assert there == pytest.approx(here, rel=1e-9)


def test_distance_twin(body, bank, prior):
    """Mahalanobis' distance to all poses of the bank and their mirror images, by NumPy's inverse."""
    rotations = np.stack([bank.rotations(k) for k in range(bank.poses)])
    nodes = forward_kinematics(rotations, np.zeros((len(rotations), 3)), bank.body.nodes)
    joints = kernels.in_trunk_axes_all(nodes[:, JOINT_NODES])
    both = np.concatenate([joints, joints[:, MIRROR_JOINTS] * [-1.0, 1.0, 1.0]]).reshape(-1, 57)
    covariance = np.cov(both.T) + 0.02**2 * np.eye(57)
    for number in range(0, bank.poses, 60):
        off = joints[number].ravel() - both.mean(axis=0)
        expected = np.sqrt(off @ np.linalg.inv(covariance) @ off / 57)
        assert prior.distance(_nodes(bank.body, rotations[number]), 1.0) == pytest.approx(expected, rel=1e-5)
