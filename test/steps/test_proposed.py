"""Exemplars by joints: what has its joints where they are proposed is found, and lies on them."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_NODES, MIRROR_JOINTS, forward_kinematics
from depth_pose.core.types import FoundPerson
from depth_pose.fit.aim import aim_limbs
from depth_pose.fit.articulated import BodyPose
from depth_pose.steps.proposed import ProposedExemplars

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
    return FoundPerson(1, "a", 1.0, joints.astype(np.float32), sure)


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
    nobody = FoundPerson(1, "a", 1.0, np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
    assert exemplars.find(nobody, 1.0) is None
    assert aim_limbs(bank.body, pose_of(bank, 0, 0.0), nobody) is None


def test_limbs_are_aimed_where_proposals_are_sure_and_nowhere_else(bank):
    start, target = pose_of(bank, 12, 0.0), pose_of(bank, 90, 0.0)
    own, wanted = joints_of(bank.body, start), joints_of(bank.body, target)
    confidence = np.full(19, 0.1)
    confidence[[6, 7]] = 0.9  # left elbow and wrist
    aimed = aim_limbs(bank.body, start, found(wanted, confidence))
    reached = joints_of(bank.body, aimed)
    others = np.delete(np.arange(19), [6, 7])
    np.testing.assert_allclose(reached[others], own[others], atol=1e-6)
    bone, way = reached[6] - reached[5], wanted[6] - own[5]
    assert bone @ way > 0.999 * np.linalg.norm(bone) * np.linalg.norm(way)
    assert np.linalg.norm(reached[7] - wanted[7]) < np.linalg.norm(own[7] - wanted[7])
    assert aim_limbs(bank.body, start, found(wanted, 0.1)) is None
