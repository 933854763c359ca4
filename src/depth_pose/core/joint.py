"""One joint of a published skeleton, and covariances as messages carry them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import JointName, JointState


class Joint(NamedTuple):
    """One joint of a skeleton.

    Attributes
    ----------
    name : str
        One of `depth_pose.JOINTS`.
    position : (3,) float64
        Centre of rotation in the camera frame (x right, y down, z forward), metres.
    quat_xyzw : (4,) float64
        Rotation of the segment that begins at the joint, rest pose to camera frame.
    confidence : float
        Probability that the position is within 10 cm, 0 to 1.
    state : JointState
        SEEN, OCCLUDED, OUTSIDE_IMAGE or LOST.
    velocity : (3,) float64
        Camera frame, m/s; NaN where it is unknown.
    covariance : (3, 3) float64
        Of the position, camera frame, m^2; NaN where it is unknown.
    """

    name: JointName
    position: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    confidence: float
    state: JointState
    velocity: NDArray[np.float64]
    covariance: NDArray[np.float64]


_ROWS, _COLUMNS = np.triu_indices(3)


def six_numbers(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return xx, xy, xz, yy, yz, zz (..., 6) of covariances (..., 3, 3), as in the messages."""
    return covariances[..., _ROWS, _COLUMNS]


def symmetric(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the covariances (..., 3, 3) of which `six_numbers` gives the numbers (..., 6)."""
    covariances = np.empty((*numbers.shape[:-1], 3, 3))
    covariances[..., _ROWS, _COLUMNS] = covariances[..., _COLUMNS, _ROWS] = numbers
    return covariances
