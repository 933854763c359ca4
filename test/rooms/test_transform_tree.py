"""Chains of frames, against products of matrices written out."""

import numpy as np
import pytest

from depth_pose.core.errors import ConfigError
from depth_pose.rooms.transform_tree import TransformTree, pose_matrix
from synthetic import transform


def test_a_pose_is_a_matrix():
    half = np.sqrt(0.5)
    T = pose_matrix([1.0, 2.0, 3.0, 0.0, 0.0, 2 * half, 2 * half])  # a quarter turn about z, unnormalised
    assert np.allclose(T @ [1.0, 0.0, 0.0, 1.0], [1.0, 3.0, 3.0, 1.0])
    for bad in ([0.0] * 7, [np.nan] * 3 + [0.0, 0.0, 0.0, 1.0]):
        with pytest.raises(ConfigError, match="has no place or no rotation"):
            pose_matrix(bad)


def test_chains_up_down_and_across():
    """map > rail > bracket > camera, and map > floor: from any to any."""
    a, b, c, d = (transform(i) for i in range(4))
    tree = TransformTree()
    tree.add("bracket", "camera", c)  # told in any order, with or without a slash
    tree.add("/map", "/rail", a)
    tree.add("rail", "bracket", b)
    tree.add("map", "floor", d)
    assert np.allclose(tree.find("map", "camera"), a @ b @ c)
    assert np.allclose(tree.find("/map", "/camera"), a @ b @ c)
    assert np.allclose(tree.find("camera", "map"), np.linalg.inv(a @ b @ c))
    assert np.allclose(tree.find("floor", "bracket"), np.linalg.inv(d) @ a @ b)
    assert np.allclose(tree.find("camera", "camera"), np.eye(4))
    tree.add("rail", "bracket", transform(9))
    assert np.allclose(tree.find("map", "camera"), a @ transform(9) @ c)


def test_frames_that_nothing_joins():
    tree = TransformTree()
    assert tree.find("map", "camera") is None
    tree.add("odom", "camera", transform(1))
    assert tree.find("map", "camera") is None
    tree.add("camera", "odom", transform(2))  # a circle
    assert tree.find("map", "camera") is None
    assert tree.find("odom", "camera") is None
