"""Compiled loops of the pose prior; see `depth_pose.refine.pose_prior`."""

from __future__ import annotations

import numpy as np

from depth_pose.core.kernels import njit
from depth_pose.core.skeleton import JOINT_INDEX

_LEFT_SHOULDER, _RIGHT_SHOULDER = JOINT_INDEX["left_shoulder"], JOINT_INDEX["right_shoulder"]
_LEFT_HIP, _RIGHT_HIP = JOINT_INDEX["left_hip"], JOINT_INDEX["right_hip"]
_NECK, _PELVIS = JOINT_INDEX["neck"], JOINT_INDEX["pelvis"]

_USUAL = 0.7
"""Distance up to which a pose costs nothing; the bank's median is 0.65, its 95th percentile 0.98."""


@njit(cache=True)
def in_trunk_axes(joints, out):
    """Transform joints (19, 3) to the trunk's axes: left, up, forward; the origin is the trunk's middle.

    The middle is that of shoulders and hips. Returns the axes, (3, 3), in rows.
    """
    axes, middle = np.empty((3, 3)), np.empty(3)
    for a in range(3):
        left = joints[_LEFT_SHOULDER, a] + joints[_LEFT_HIP, a]
        right = joints[_RIGHT_SHOULDER, a] + joints[_RIGHT_HIP, a]
        axes[0, a], middle[a] = left - right, 0.25 * (left + right)
        axes[1, a] = joints[_NECK, a] - joints[_PELVIS, a]
    axes[1] /= max(np.sqrt((axes[1] ** 2).sum()), 1e-9)
    axes[0] -= (axes[0] * axes[1]).sum() * axes[1]
    axes[0] /= max(np.sqrt((axes[0] ** 2).sum()), 1e-9)
    axes[2] = np.cross(axes[0], axes[1])
    for j in range(joints.shape[0]):
        for a in range(3):
            out[j, a] = 0.0
            for b in range(3):
                out[j, a] += axes[a, b] * (joints[j, b] - middle[b])
    return axes


@njit(cache=True)
def in_trunk_axes_all(joints):
    """Transform the joints of poses (N, 19, 3) to the axes of their trunks."""
    out = np.empty(joints.shape)
    for k in range(joints.shape[0]):
        in_trunk_axes(joints[k], out[k])
    return out


@njit(cache=True)
def distance(joints, scale, mean, whiten):
    """Compute the root mean square of the whitened coordinates of a pose's joints (19, 3)."""
    local = np.empty(joints.shape)
    in_trunk_axes(joints, local)
    off = local.ravel() / scale - mean
    total = 0.0
    for i in range(whiten.shape[0]):
        value = 0.0
        for j in range(i + 1):
            value += whiten[i, j] * off[j]
        total += value * value
    return np.sqrt(total / whiten.shape[0])


@njit(cache=True)
def excess(joints, scale, mean, whiten):
    """Compute the distance of a pose above the usual; 0 for most."""
    return max(0.0, distance(joints, scale, mean, whiten) - _USUAL)
