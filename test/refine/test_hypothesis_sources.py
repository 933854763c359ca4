"""Sources of hypotheses: limbs turned to the measured joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depth_pose.body.pose import BodyPose
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, forward_kinematics
from depth_pose.refine.sources import from_joints


def pose_of(bank, exemplar):
    return BodyPose(R_CAMERA_FACING_MODEL @ bank.rotations(exemplar), np.array([0.3, 0.1, 2.6]), 1.0)


def joints_of(body, pose):
    return forward_kinematics(pose.rotations, pose.root, body.nodes, pose.scale)[JOINT_NODES]


def found(joints, confidence=0.9):
    sure = np.broadcast_to(np.float32(confidence), (19,)).astype(np.float32)
    return JointMeasurement(joints.astype(np.float32), np.full((19, 2), 0.05, np.float32), sure)


@pytest.mark.parametrize("limb", [("hip", "knee", "ankle", "foot"), ("shoulder", "elbow", "wrist")])
def test_limbs_are_aimed_where_proposals_are_sure_and_nowhere_else(bank, limb):
    start, target = pose_of(bank, 12), pose_of(bank, 90)
    own, wanted = joints_of(bank.body, start), joints_of(bank.body, target)
    root, middle, end, *more = (JOINT_INDEX[f"left_{name}"] for name in limb)
    confidence = np.full(19, 0.1)
    confidence[[middle, end]] = 0.9
    sure = replace(found(wanted, confidence), sigma=np.full((19, 2), 0.001, np.float32))
    ((aimed, source),) = from_joints(bank.body, start, sure)
    assert source == "joints"
    reached = joints_of(bank.body, aimed)
    others = np.delete(np.arange(19), [middle, end, *more])
    np.testing.assert_allclose(reached[others], own[others], atol=1e-6)
    bone, way = reached[middle] - reached[root], wanted[middle] - own[root]
    assert bone @ way > 0.999 * np.linalg.norm(bone) * np.linalg.norm(way)
    assert np.linalg.norm(reached[end] - wanted[end]) < np.linalg.norm(own[end] - wanted[end])
    assert from_joints(bank.body, start, found(wanted, 0.1)) == from_joints(bank.body, start, None) == []
