"""The shared vocabulary: names, tree, proportions, kinematics, mirroring."""

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import (
    BONES,
    JOINT_INDEX,
    JOINT_NODES,
    JOINTS,
    MIRROR_JOINTS,
    MIRROR_NODES,
    NODE_INDEX,
    NODE_PARENTS,
    NODES,
    JointState,
    Source,
    forward_kinematics,
    mirror_rotations,
    rest_nodes,
)


def test_counts_and_names():
    assert len(JOINTS) == len(set(JOINTS)) == 19
    assert len(NODES) == len(set(NODES)) == 21
    assert set(NODES) - set(JOINTS) == {"left_clavicle", "right_clavicle"}
    assert [NODES[n] for n in JOINT_NODES] == list(JOINTS)


def test_parents_come_first():
    assert NODE_PARENTS[0] == -1
    assert (NODE_PARENTS[1:] < np.arange(1, 21)).all()
    assert (NODE_PARENTS[1:] >= 0).all()


def test_bones_connect_all_joints_as_a_tree():
    assert len(BONES) == 18
    assert sorted(child for _, child in BONES) == sorted(set(range(19)) - {JOINT_INDEX["pelvis"]})
    assert (JOINT_INDEX["chest"], JOINT_INDEX["left_shoulder"]) in BONES
    assert (JOINT_INDEX["pelvis"], JOINT_INDEX["right_hip"]) in BONES


@pytest.mark.parametrize(("mirror", "names"), [(MIRROR_NODES, NODES), (MIRROR_JOINTS, JOINTS)])
def test_mirror_exchanges_the_sides(mirror, names):
    np.testing.assert_array_equal(mirror[mirror], np.arange(len(names)))
    for i, name in enumerate(names):
        other = names[mirror[i]]
        assert other == name.replace("left", "X").replace("right", "left").replace("X", "right")


def test_values_of_the_messages():
    assert [s.value for s in JointState] == [0, 1, 2, 3]
    assert [s.name for s in JointState] == ["SEEN", "OCCLUDED", "OUTSIDE_IMAGE", "LOST"]
    assert [s.name for s in Source] == ["MATCHED", "REFINED", "RECOVERED", "VOLUME", "LOST"]


def test_rest_pose_has_the_stated_proportions():
    nodes = rest_nodes()
    heights = {
        "pelvis": 0.564, "spine": 0.647, "chest": 0.775, "neck": 0.877, "head": 0.937, "left_shoulder": 0.820,
        "left_hip": 0.557, "left_knee": 0.318, "left_ankle": 0.072, "left_foot": 0.044,
    }  # fmt: skip
    for name, height in heights.items():
        assert nodes[NODE_INDEX[name], 1] == pytest.approx(height), name
    assert nodes[NODE_INDEX["left_shoulder"], 0] == pytest.approx(0.100)
    assert nodes[NODE_INDEX["left_hip"], 0] == pytest.approx(0.063)
    lengths = {
        ("shoulder", "elbow"): 0.155, ("elbow", "wrist"): 0.140, ("hip", "knee"): 0.241,
        ("knee", "ankle"): 0.248, ("ankle", "foot"): 0.090,
    }  # fmt: skip
    for side in ("left", "right"):
        for (a, b), length in lengths.items():
            bone = nodes[NODE_INDEX[f"{side}_{a}"]] - nodes[NODE_INDEX[f"{side}_{b}"]]
            assert np.linalg.norm(bone) == pytest.approx(length, abs=1e-9), (side, a)
    np.testing.assert_allclose(nodes[MIRROR_NODES] * [-1, 1, 1], nodes)
    assert nodes[NODE_INDEX["left_shoulder"], 0] > 0  # x is the person's left
    assert nodes[NODE_INDEX["left_foot"], 2] > nodes[NODE_INDEX["left_ankle"], 2]  # z is forward
    arm = nodes[NODE_INDEX["left_wrist"]] - nodes[NODE_INDEX["left_shoulder"]]
    assert np.degrees(np.arctan2(-arm[1], arm[0])) == pytest.approx(45.0)


def test_kinematics_of_the_rest_pose():
    rest = rest_nodes()
    np.testing.assert_allclose(forward_kinematics(syn.upright(), rest[0], rest), rest, atol=1e-12)
    twice = forward_kinematics(syn.upright(), 2 * rest[0], rest, 2.0)
    np.testing.assert_allclose(twice, 2 * rest, atol=1e-12)


def test_kinematics_twin():
    """Every node's offset from its parent is turned by the parent's segment."""
    rest, rotations = rest_nodes() * 1.75, syn.varied(0, 40.0)
    nodes = forward_kinematics(rotations, np.array([1.0, 2.0, 3.0]), rest, 0.9)
    np.testing.assert_allclose(nodes[0], [1, 2, 3])
    for n in range(1, 21):
        p = NODE_PARENTS[n]
        np.testing.assert_allclose(nodes[n] - nodes[p], 0.9 * rotations[p] @ (rest[n] - rest[p]), atol=1e-12)


def test_kinematics_of_many_poses_at_once():
    rest = rest_nodes()
    many = np.stack([syn.varied(i, 30.0) for i in range(4)]).reshape(2, 2, 21, 3, 3)
    roots = np.random.default_rng(0).standard_normal((2, 2, 3))
    nodes = forward_kinematics(many, roots, rest)
    np.testing.assert_allclose(nodes[1, 0], forward_kinematics(many[1, 0], roots[1, 0], rest))


def test_rigid_motion_moves_all_nodes_equally():
    rest, rotations = rest_nodes(), syn.varied(1, 40.0)
    turn = syn.rotation("y", 70.0) @ syn.rotation("x", 20.0)
    root = np.array([0.3, 0.1, 2.0])
    moved = forward_kinematics(turn @ rotations, turn @ root, rest)
    np.testing.assert_allclose(moved, forward_kinematics(rotations, root, rest) @ turn.T, atol=1e-12)


def test_mirrored_rotations_mirror_the_nodes():
    rest, rotations = rest_nodes(), syn.varied(2, 40.0)
    mirrored = mirror_rotations(rotations)
    np.testing.assert_allclose(np.linalg.det(mirrored), 1.0)
    np.testing.assert_allclose(mirror_rotations(mirrored), rotations)
    nodes = forward_kinematics(rotations, np.zeros(3), rest)
    np.testing.assert_allclose(
        forward_kinematics(mirrored, np.zeros(3), rest), syn.mirrored(nodes), atol=1e-12
    )


def test_a_lost_skeleton_has_no_joints():
    lost = Skeleton.lost(5, "optical")
    assert lost.is_lost
    assert (lost.stamp_ns, lost.frame_id, lost.source) == (5, "optical", Source.LOST)
    for name in ("positions", "quats_xyzw", "joint_confidence", "joint_states"):
        assert len(getattr(lost, name)) == 0
