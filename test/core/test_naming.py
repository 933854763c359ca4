"""Measured joints are named as those that they are compared with."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINTS, MIRROR_JOINTS
from depth_pose.refine._aim_kernels import nearer_naming


def measured(seed: int) -> JointMeasurement:
    rng = np.random.default_rng(seed)
    places = rng.normal([0.0, 0.0, 3.0], 0.4, (len(JOINTS), 3)).astype(np.float32)
    sure = rng.uniform(0.1, 1.0, len(JOINTS)).astype(np.float32)
    return JointMeasurement(places, np.full((len(JOINTS), 2), 0.05, np.float32), sure)


@pytest.mark.parametrize("is_exchanged", [False, True])
def test_joints_are_named_as_those_that_they_are_compared_with(is_exchanged) -> None:
    one = measured(1)
    names = MIRROR_JOINTS if is_exchanged else np.arange(len(JOINTS))
    named = one.named_like(one.places[names].astype(np.float64) + 0.02)
    assert named.is_exchanged == is_exchanged
    np.testing.assert_array_equal(named.places, one.places[names])
    np.testing.assert_array_equal(named.confidence, one.confidence[names])


def test_the_fit_names_them_alike() -> None:
    """The compiled fit chooses the same naming for arbitrary poses."""
    rng = np.random.default_rng(0)
    for seed in range(20):
        one, joints = measured(seed), rng.normal([0.0, 0.0, 3.0], 0.4, (len(JOINTS), 3))
        side = nearer_naming(joints, one.both.places, one.both.weights)
        assert one.named_like(joints).is_exchanged == (side == 1)
