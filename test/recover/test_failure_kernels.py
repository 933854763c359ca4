"""The compiled check of one skeleton's angles says what the conversions of many at once say."""

from __future__ import annotations

import numpy as np

from depth_pose.body.angles import ANGLES, angles_from_rotations
from depth_pose.body.limits import violation
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.recover import failure

_JUDGED = np.array(
    [
        any(part in name for part in ("spine", "chest", "shoulder_", "elbow", "hip_", "knee"))
        and "shoulder_twist" not in name
        for name in ANGLES
    ]
)
"""Angles that show a failure; hands, feet, head and the arms' twist are seen too poorly to tell."""


def test_says_what_the_conversions_of_many_say() -> None:
    rng = np.random.default_rng(5)
    for spread in (0.1, 0.4, 1.0, 2.0):
        for rotations in rotvec_to_matrix(rng.normal(0.0, spread, (200, 21, 3))):
            own = rotations[0].T @ rotations
            expected = np.where(_JUDGED, violation(angles_from_rotations(own)), 0.0)
            np.testing.assert_allclose(failure.excess_of(own), expected, atol=1e-9)
