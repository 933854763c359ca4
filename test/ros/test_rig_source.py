"""Where cameras are, from the messages that say it."""

import sys

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from std_msgs.msg import Header

from depth_pose.core.errors import ConfigError
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.rooms.transform_tree import TransformTree
from depth_pose.ros.transport.rig_source import add_transforms, given_extrinsics
from depth_pose.ros.transport.tf import tf_message
from synthetic import transform


def stamped(parent, child, T):
    x, y, z, w = (float(q) for q in matrix_to_quat(T[:3, :3]))
    move = Vector3(x=float(T[0, 3]), y=float(T[1, 3]), z=float(T[2, 3]))
    turn = Quaternion(x=x, y=y, z=z, w=w)
    return TransformStamped(
        header=Header(frame_id=parent),
        child_frame_id=child,
        transform=Transform(translation=move, rotation=turn),
    )


def test_transforms_of_messages():
    frames = TransformTree()
    add_transforms(frames, [stamped("link", "optical", transform(1)), stamped("map", "link", transform(2))])
    assert np.allclose(frames.find("map", "optical"), transform(2) @ transform(1))
    broken = stamped("map", "link", np.eye(4))
    broken.transform.rotation.w = 0.0
    (refused,) = add_transforms(frames, [broken, stamped("map", "tripod", transform(4))])
    assert "no rotation" in str(refused)
    assert np.allclose(frames.find("map", "tripod"), transform(4))  # one that is wrong costs others nothing


def test_extrinsics_of_a_parameter():
    T = transform(3)
    pose = [*T[:3, 3], *matrix_to_quat(T[:3, :3])]
    assert np.allclose(given_extrinsics(pose * 2, 2), [T, T])
    assert given_extrinsics([0.0], 2) is None  # not given
    with pytest.raises(ConfigError, match="2 cameras need 14"):
        given_extrinsics(pose, 2)


def test_without_tf2_msgs_it_says_what_to_give_instead(monkeypatch):
    monkeypatch.setitem(sys.modules, "tf2_msgs", None)  # as where it is not installed
    monkeypatch.delitem(sys.modules, "tf2_msgs.msg", raising=False)
    with pytest.raises(ConfigError, match=r"give the parameter rig or extrinsics.*ros-jazzy-tf2-msgs"):
        tf_message("the cameras' places (else give the parameter rig or extrinsics)")
