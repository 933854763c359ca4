"""Two-link inverse kinematics: arm angles for a wrist position, leg angles for an ankle position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import (
    FOREARM_M,
    SHANK_M,
    THIGH_M,
    UPPER_ARM_M,
    relative,
    swing_twist_angles,
    trunk_angles,
)
from depth_pose.core.rotations import rotation_x, rotation_y

Array = NDArray[np.float64]


def arm_to_target(target: Array, pole: Array) -> Array:
    """Shoulder and elbow angles that bring the left wrist to a place.

    Parameters
    ----------
    target : (..., 3)
        Wrist relative to the shoulder in the chest's frame (x left, y up, z forward), metres,
        for a 1.75 m body. Places out of reach are approached with a straight arm.
    pole : (..., 3)
        Direction to which the elbow points.

    Returns
    -------
    (..., 9) float64
        Angles of `ARM_ANGLES`, degrees; clavicle and hand at zero.
    """
    x, u, flexion = _two_links(target, -np.asarray(pole), UPPER_ARM_M, FOREARM_M)
    rotation = np.stack([x, -u, np.cross(x, -u)], axis=-1)
    out = np.zeros((*u.shape[:-1], 9))
    out[..., 2:5] = swing_twist_angles(rotation)
    out[..., 5] = flexion
    return out


def _two_links(target: Array, front: Array, first: float, second: float) -> tuple[Array, Array, Array]:
    """Hinge axis x, direction of the first link and flexion (degrees) of a two-link limb.

    ``front`` is the side to which the second link folds (the elbow points to ``-front``).
    """
    target, front = np.broadcast_arrays(target, front)
    distance = np.linalg.norm(target, axis=-1, keepdims=True)
    axis = target / np.maximum(distance, 1e-6)
    d = np.clip(distance[..., 0], abs(first - second) + 0.02, (first + second) * 0.9995)
    flexion = np.pi - np.arccos(np.clip((first**2 + second**2 - d**2) / (2 * first * second), -1, 1))
    bend = np.arccos(np.clip((first**2 + d**2 - second**2) / (2 * first * d), -1, 1))
    front = front - np.sum(front * axis, axis=-1, keepdims=True) * axis
    front = front / np.maximum(np.linalg.norm(front, axis=-1, keepdims=True), 1e-6)
    u = np.cos(bend)[..., None] * axis - np.sin(bend)[..., None] * front

    x = np.cross(front, axis)
    x = x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-6)
    return x, u, np.degrees(flexion)


def leg_to_target(ankle: Array, toe_out: Array, pitch: Array, pelvis: Array) -> Array:
    """Leg angles that bring the left ankle to a place with the foot at a given attitude.

    Parameters
    ----------
    ankle : (..., 3)
        Ankle relative to the hip, axes of the model frame, metres, for a 1.75 m body.
    toe_out : (...)
        Direction of the foot from straight ahead, outward positive, degrees; the knee follows it.
    pitch : (...)
        Foot attitude, degrees: positive with the heel raised.
    pelvis : (..., 3, 3)
        Rotation of the pelvis.

    Returns
    -------
    (..., 7) float64
        Angles of `LEG_ANGLES`, degrees.
    """
    turn = rotation_y(np.radians(np.asarray(toe_out, dtype=np.float64)))
    knee_front = turn[..., :, 2]
    x, u, flexion = _two_links(ankle, -knee_front, THIGH_M, SHANK_M)
    x = -x
    thigh = np.stack(np.broadcast_arrays(x, -u, np.cross(x, -u)), axis=-1)
    shank = thigh @ rotation_x(np.radians(flexion))
    foot = turn @ rotation_x(np.radians(pitch))
    out = np.zeros((*u.shape[:-1], 7))
    out[..., :3] = swing_twist_angles(relative(pelvis, thigh))
    out[..., 3] = flexion
    attitude = trunk_angles(relative(shank, foot))
    out[..., 4], out[..., 5], out[..., 6] = -attitude[..., 0], attitude[..., 1], attitude[..., 2]
    return out
