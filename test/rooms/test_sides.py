"""Cameras that take the front for the back."""

from __future__ import annotations

import numpy as np
import pytest
from walkers import standing

from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix, rotation_z
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, JOINTS, NODES, forward_kinematics, rest_nodes
from depth_pose.rooms.merge import PlacedSkeleton
from depth_pose.rooms.sides import agree_on_sides, exchange_sides
from skeletons import make_skeleton

TRUTH = standing(0.0, 0.0)
BACK = standing(0.0, 0.0, yaw=np.pi)  # the same places, nearly, with sides exchanged
SHOULDER = JOINT_INDEX["left_shoulder"]


def seen(positions: np.ndarray, confidence: float = 0.9) -> PlacedSkeleton:
    return PlacedSkeleton(make_skeleton(positions, confidence=confidence), np.zeros(3), np.zeros(3))


def sides(agreed: list[PlacedSkeleton]) -> list[bool]:
    """Whether each skeleton's left shoulder is where it is in truth."""
    return [bool(np.linalg.norm(s.skeleton.positions[SHOULDER] - TRUTH[SHOULDER]) < 0.15) for s in agreed]


@pytest.mark.parametrize(
    ("shown", "before", "right"),
    [
        ([seen(TRUTH), seen(BACK, 0.8)], None, True),  # the surer one is followed
        ([seen(TRUTH, 0.8), seen(BACK)], None, False),
        ([seen(TRUTH, 0.8), seen(BACK)], TRUTH, True),  # as it was before
        ([seen(BACK), seen(TRUTH, 0.8), seen(TRUTH, 0.8)], None, True),  # two against one
        ([seen(TRUTH), seen(BACK), seen(BACK), seen(BACK)], TRUTH, False),  # three are more than the past
        ([seen(BACK), seen(BACK)], TRUTH, False),  # all agree: they have turned, or been wrong
    ],
)
def test_all_agree_on_sides(shown, before, right):
    agreed = agree_on_sides(shown, before)
    assert sides(agreed) == [right] * len(shown)


def test_who_agrees_is_left_as_they_are():
    shown = [seen(TRUTH), seen(TRUTH + 0.03)]
    assert [a.skeleton is b.skeleton for a, b in zip(agree_on_sides(shown, TRUTH), shown, strict=True)]


def test_rotations_of_exchanged_sides_pose_the_same_places():
    """Of a bent figure: forward kinematics of the exchanged rotations reach the exchanged joints."""
    rng = np.random.default_rng(0)
    rest = rest_nodes()
    turns = quat_to_matrix(matrix_to_quat(rotation_z(rng.uniform(-0.5, 0.5, len(NODES)))))
    nodes = forward_kinematics(turns, np.zeros(3), rest)
    skeleton = make_skeleton(nodes[JOINT_NODES], quats_xyzw=matrix_to_quat(turns[JOINT_NODES]))
    exchanged = exchange_sides(skeleton)
    for parent, child in (("left_shoulder", "left_elbow"), ("right_hip", "right_knee"), ("pelvis", "spine")):
        bone = exchanged[child].position - exchanged[parent].position
        assert np.allclose(bone, _rotated(exchanged, parent, child, rest), atol=0.03)
    assert np.allclose(exchange_sides(exchanged).positions, skeleton.positions)
    R = quat_to_matrix(exchange_sides(exchanged).quats_xyzw)
    assert np.allclose(R, quat_to_matrix(skeleton.quats_xyzw))


def _rotated(skeleton: Skeleton, parent: str, child: str, rest: np.ndarray) -> np.ndarray:
    """Return the bone of the rest pose, turned as the skeleton says."""
    bone = rest[JOINT_NODES[JOINTS.index(child)]] - rest[JOINT_NODES[JOINTS.index(parent)]]
    return quat_to_matrix(skeleton[parent].quat_xyzw) @ bone
