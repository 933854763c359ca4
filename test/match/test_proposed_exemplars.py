"""Exemplars by joints: what has its joints where they are proposed is found, and lies on them."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.body.pose import BodyPose
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_NODES, MIRROR_JOINTS, forward_kinematics
from depth_pose.match.proposed_exemplars import ProposedExemplars
from depth_pose.refine._aim_kernels import mean_deviation

AHEAD = np.array([0.3, 0.1, 2.6])


@pytest.fixture(scope="module")
def exemplars(bank):
    return ProposedExemplars(bank)


def pose_of(bank, exemplar, turn, scale=1.0):
    return BodyPose(syn.rotation("y", turn) @ R_CAMERA_FACING_MODEL @ bank.rotations(exemplar), AHEAD, scale)


def joints_of(body, pose):
    return forward_kinematics(pose.rotations, pose.root, body.nodes, pose.scale)[JOINT_NODES]


def found(joints, confidence=0.9):
    sure = np.broadcast_to(np.float32(confidence), (19,)).astype(np.float32)
    return JointMeasurement(joints.astype(np.float32), np.full((19, 2), 0.05, np.float32), sure)


@pytest.mark.parametrize("exemplar", [3, 90, 201])
@pytest.mark.parametrize(("turn", "scale"), [(0.0, 1.0), (70.0, 0.8), (180.0, 1.1)])
def test_an_exemplar_is_found_by_its_joints_and_by_its_mirrored_names(bank, exemplars, exemplar, turn, scale):
    joints = joints_of(bank.body, pose_of(bank, exemplar, turn, scale))
    for named, first in ((joints, 0), (joints[MIRROR_JOINTS], 8)):
        placed = exemplars.find(found(named), scale)
        assert placed.exemplars[first] == exemplar
        np.testing.assert_allclose(placed.translations[first], AHEAD, atol=1e-4)
        there = BodyPose(
            placed.rotations[first] @ bank.rotations(exemplar), placed.translations[first], scale
        )
        np.testing.assert_allclose(joints_of(bank.body, there), joints, atol=1e-4)


def test_a_joint_that_nobody_is_sure_of_does_not_count(bank, exemplars):
    joints = joints_of(bank.body, pose_of(bank, 90, 20.0))
    joints[7] += 0.8
    confidence = np.full(19, 0.9)
    confidence[7] = 0.01
    assert exemplars.find(found(joints, confidence), 1.0).exemplars[0] == 90


def test_without_proposals_there_is_nothing(bank, exemplars):
    assert exemplars.find(None, 1.0) is None


def test_distances_from_proposals_count_in_their_standard_deviations(bank):
    pose = pose_of(bank, 12, 0.0)
    nodes = forward_kinematics(pose.rotations, pose.root, bank.body.nodes, pose.scale)
    joints = nodes[JOINT_NODES]
    sigma = np.tile(np.float32([0.03, 0.05]), (19, 1))
    across, along = np.hypot([0.03, 0.05], 0.04)
    ray = joints[7] / np.linalg.norm(joints[7])
    aside = np.cross(ray, [0.0, 1.0, 0.0])
    aside /= np.linalg.norm(aside)

    def moved(by):
        places = joints.copy()
        places[7] += by
        return mean_deviation(joints, places.astype(np.float32), sigma, 5.0)

    assert moved(np.zeros(3)) == pytest.approx(0.0, abs=1e-5)
    assert moved(0.1 * aside) == pytest.approx(0.1 / across / 19, rel=0.02)
    assert moved(0.1 * ray) == pytest.approx(0.1 / along / 19, rel=0.02)
    assert moved(4.0 * ray) == pytest.approx(5.0 / 19, rel=1e-4)  # and no more


def test_a_first_guess_of_the_size(bank, exemplars):
    for scale in (0.7, 1.0, 1.15):
        joints = joints_of(bank.body, pose_of(bank, 30, 40.0, scale))
        assert exemplars.size(found(joints)) == pytest.approx(scale, rel=0.06)
