"""Compiled joint angles of one skeleton and their excess over the limits, for `depth_pose.recover.failure`.

Computes the same as `depth_pose.body.angles` and `depth_pose.body.limits`, which handle many poses, but five
times faster for a single one (``test/recover/test_failure_kernels.py`` compares them). Only the angles that
reveal failures are computed: spine, chest, elbows, knees, hips and the direction of the upper arms.
"""

from __future__ import annotations

import numpy as np

from depth_pose.body.angles import ARM, LEG
from depth_pose.body.limits import HIGH, LOW, OVERHEAD_DEG
from depth_pose.core._rotation_kernels import multiply
from depth_pose.core.kernels import njit
from depth_pose.core.skeleton import NODE_INDEX

_TRUNK = tuple(NODE_INDEX[name] for name in ("pelvis", "spine", "chest"))
_ARMS, _LEGS = (
    tuple(tuple(NODE_INDEX[f"{side}_{name}"] for name in names) for side in ("left", "right"))
    for names in (("shoulder", "elbow"), ("hip", "knee"))
)
_ARM_AT, _LEG_AT = tuple(a.start for a in ARM), tuple(a.start for a in LEG)


@njit(cache=True)
def limit_excess(rotations, hang_arm, hang_leg, out):
    """Write the excess (47,) of each judged angle over its limit, degrees, into ``out``.

    ``rotations`` (21, 3, 3) are relative to the pelvis; ``hang_arm``, ``hang_leg`` (2, 3, 3) rotate the left
    upper and lower segment from rest to hanging.
    """
    out[:] = 0.0
    rotation = np.empty((3, 3))
    for k in range(1, 3):
        multiply(rotations[_TRUNK[k - 1]].T, rotations[_TRUNK[k]], rotation)
        at = 3 * k
        out[at] = _excess(at, np.degrees(np.arcsin(min(max(-rotation[1, 2], -1.0), 1.0))))
        out[at + 1] = _excess(at + 1, np.degrees(-np.arctan2(rotation[1, 0], rotation[1, 1])))
        out[at + 2] = _excess(at + 2, np.degrees(np.arctan2(rotation[0, 2], rotation[2, 2])))
    for side in range(2):
        _limb(rotations, _TRUNK[2], _ARMS[side], side, hang_arm, _ARM_AT[side] + 2, _ARM_AT[side] + 5, out)
        _limb(rotations, _TRUNK[0], _LEGS[side], side, hang_leg, _LEG_AT[side], _LEG_AT[side] + 3, out)


@njit(cache=True)
def _excess(number, angle):
    """Compute how far an angle lies outside its range, degrees."""
    return max(LOW[number] - angle, angle - HIGH[number], 0.0)


@njit(cache=True)
def _mirrored(rotation, side, out):
    """Copy a rotation; on the right side mirror it at x = 0."""
    flip = 1.0 if side == 0 else -1.0
    for i in range(3):
        for j in range(3):
            out[i, j] = rotation[i, j] * (flip if (i == 0) != (j == 0) else 1.0)


@njit(cache=True)
def _limb(rotations, trunk, nodes, side, hang, swing_at, bend_at, out):
    """Write the excess of an upper segment's swing relative to the trunk, and of the lower segment's bend."""
    base, segment = np.empty((3, 3)), np.empty((3, 3))
    upper, lower, rotation = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    _mirrored(rotations[trunk], side, base)
    _mirrored(rotations[nodes[0]], side, segment)
    multiply(segment, hang[0].T, upper)
    _mirrored(rotations[nodes[1]], side, segment)
    multiply(segment, hang[1].T, lower)
    multiply(base.T, upper, rotation)
    is_arm = swing_at == _ARM_AT[side] + 2
    u, v, w = -rotation[0, 1], -rotation[1, 1], -rotation[2, 1]
    sine = np.hypot(u, w)
    factor = np.arctan2(sine, -v) / max(sine, 1e-9) if sine > 1e-9 else 1.0
    flexion, abduction = np.degrees(factor * w), np.degrees(factor * u)
    _judge_swing(flexion, abduction, swing_at, is_arm, out)
    if not is_arm:
        out[swing_at + 2] = _excess(
            swing_at + 2, _twist(rotation, np.radians(flexion), np.radians(abduction))
        )
    multiply(upper.T, lower, rotation)
    bend = -rotation[2, 1] if is_arm else rotation[2, 1]
    out[bend_at] = _excess(bend_at, np.degrees(np.arctan2(bend, rotation[1, 1])))


@njit(cache=True)
def _judge_swing(flexion, abduction, at, is_arm, out):
    """Compare a swing with its cone, a quarter ellipse in each quadrant, allowing half a turn overhead."""
    elevation = np.sqrt(flexion * flexion + abduction * abduction)
    if is_arm and elevation > OVERHEAD_DEG:
        left = 1.0 - min(1.0, 180.0 / max(elevation, 1.0))
        out[at], out[at + 1] = abs(flexion) * left, abs(abduction) * left
        return
    inner_f, inner_a = min(max(flexion, LOW[at]), HIGH[at]), min(max(abduction, LOW[at + 1]), HIGH[at + 1])
    f = inner_f / (HIGH[at] if inner_f >= 0 else -LOW[at])
    a = inner_a / (HIGH[at + 1] if inner_a >= 0 else -LOW[at + 1])
    size = max(np.sqrt(f * f + a * a), 1.0)
    out[at], out[at + 1] = abs(flexion - inner_f / size), abs(abduction - inner_a / size)


@njit(cache=True)
def _twist(rotation, flexion, abduction):
    """Compute the internal twist, degrees, of a rotation from hanging after removing its swing, radians."""
    size = np.sqrt(flexion * flexion + abduction * abduction)
    sinc = np.sin(size) / size if size > 1e-12 else 1.0
    half = (np.sin(0.5 * size) / (0.5 * size)) ** 2 / 2.0 if size > 1e-12 else 0.5
    x, z = -flexion, abduction  # rotation vector of the swing
    # the swing's columns: 1 + sinc [k] + half [k]^2
    swing = np.empty((3, 3))
    swing[0, 0], swing[0, 1], swing[0, 2] = 1 - half * z * z, -sinc * z, half * x * z
    swing[1, 0], swing[1, 1], swing[1, 2] = sinc * z, 1 - half * (x * x + z * z), -sinc * x
    swing[2, 0], swing[2, 1], swing[2, 2] = half * x * z, sinc * x, 1 - half * x * x
    left = np.empty((3, 3))
    multiply(swing.T, rotation, left)
    return -np.degrees(np.arctan2(left[0, 2] - left[2, 0], left[0, 0] + left[2, 2]))
