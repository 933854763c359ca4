"""Kernel that pushes limbs out of the body, pose by pose.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.kernels import njit
from depth_pose.core.skeleton import NODE_INDEX, NODE_PARENTS

Array = NDArray[np.float64]

_PARENTS = NODE_PARENTS.astype(np.int64)
_N = {name: i for name, i in NODE_INDEX.items()}
_ARMS = np.array([[_N[f"{s}_{n}"] for n in ("shoulder", "elbow", "wrist")] for s in ("left", "right")])
_LEGS = np.array([[_N[f"{s}_{n}"] for n in ("hip", "knee", "ankle", "foot")] for s in ("left", "right")])
_CHEST, _PELVIS = _N["chest"], 0
"""Nodes of the trunk; the pelvis is the root."""

_UPPER, _FORE, _HAND = 0.040, 0.032, 0.030
"""Radii of the arm's capsules (m): those of a 1.75 m body, minus 1 cm for soft tissue."""
_THIGH, _SHANK, _FOOT = 0.065, 0.045, 0.035
"""Radii of the leg's capsules (m), reduced as the arm's."""
_TRUNK = np.array(
    [
        (_N["pelvis"], -0.03, -0.01, 0.062, 0.100),
        (_N["spine"], -0.02, 0.0, 0.035, 0.095),
        (_N["spine"], 0.13, 0.0, 0.040, 0.095),
        (_N["chest"], 0.02, 0.012, 0.050, 0.100),
        (_N["neck"], -0.02, 0.0, 0.005, 0.055),
        (_N["head"], 0.055, 0.02, 0.005, 0.085),
    ]
)
"""Capsules across trunk, neck and head: node; height, depth and half-length in its frame, radius, metres.

Set by hand inside the embedded body's surface (`tools/body/anatomy.py`).
"""
_OBSTACLES = len(_TRUNK) + 4
"""The trunk's capsules, two thighs and two shanks."""
_TOUCH = 1e-4
"""Minimum penetration that is corrected (m)."""
_SLACK = 0.001
"""Clearance between limbs after separation (m)."""
_OVERLAP = 0.012
"""Maximum overlap of the two arms (m)."""
_FAR_INSIDE = 0.08
"""Penetration (m) above which an arm is moved to its own side instead of the shortest way out."""


@njit(cache=True)
def _positions(rotations: Array, rest: Array, at: Array) -> None:
    at[0] = 0.0
    for i in range(1, 21):
        p = _PARENTS[i]
        for k in range(3):
            total = at[p, k]
            for m in range(3):
                total += rotations[p, k, m] * (rest[i, m] - rest[p, m])
            at[i, k] = total


@njit(cache=True)
def _obstacles(rotations: Array, at: Array, ends: Array, radii: Array) -> None:
    """Fill the capsules that arms must not enter: trunk, neck, head, legs."""
    for i in range(len(_TRUNK)):
        node, y, z, half = int(_TRUNK[i, 0]), _TRUNK[i, 1], _TRUNK[i, 2], _TRUNK[i, 3]
        for k in range(3):
            middle = at[node, k] + rotations[node, k, 1] * y + rotations[node, k, 2] * z
            ends[i, 0, k] = middle + rotations[node, k, 0] * half
            ends[i, 1, k] = middle - rotations[node, k, 0] * half
        radii[i] = _TRUNK[i, 4]
    for side in range(2):
        hip, knee, ankle = _LEGS[side, 0], _LEGS[side, 1], _LEGS[side, 2]
        thigh, shank = 6 + 2 * side, 7 + 2 * side
        _copy(at[hip], ends[thigh, 0])
        _copy(at[knee], ends[thigh, 1])
        _copy(at[knee], ends[shank, 0])
        _copy(at[ankle], ends[shank, 1])
        radii[thigh], radii[shank] = _THIGH, _SHANK


@njit(cache=True)
def _closest(a: Array, b: Array, c: Array, d: Array) -> tuple[float, float]:
    """Return the closest points of segments ab and cd as their parameters.

    C. Ericson, *Real-Time Collision Detection*, 2005, section 5.1.9.
    """
    e1, e2, f12, g1, g2 = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        u, v, r = b[k] - a[k], d[k] - c[k], a[k] - c[k]
        e1 += u * u
        e2 += v * v
        f12 += u * v
        g1 += u * r
        g2 += v * r
    denominator = e1 * e2 - f12 * f12
    s = 0.0
    if denominator > 1e-12:
        s = min(max((f12 * g2 - g1 * e2) / denominator, 0.0), 1.0)
    t = (f12 * s + g2) / max(e2, 1e-12)
    if t < 0.0:
        t = 0.0
        s = min(max(-g1 / max(e1, 1e-12), 0.0), 1.0)
    elif t > 1.0:
        t = 1.0
        s = min(max((f12 - g1) / max(e1, 1e-12), 0.0), 1.0)
    return s, t


@njit(cache=True)
def _depth(a: Array, b: Array, c: Array, d: Array, reach: float, point: Array, normal: Array) -> float:
    """Penetration of two capsules; fills the contact on ab and the direction from cd to it."""
    s, t = _closest(a, b, c, d)
    size = 0.0
    for k in range(3):
        point[k] = a[k] + s * (b[k] - a[k])
        normal[k] = point[k] - (c[k] + t * (d[k] - c[k]))
        size += normal[k] * normal[k]
    size = np.sqrt(size)
    for k in range(3):
        normal[k] /= max(size, 1e-6)
    return float(reach - size)


@njit(cache=True)
def _copy(source: Array, target: Array) -> None:
    for k in range(3):
        target[k] = source[k]


@njit(cache=True)
def _is_zero(direction: Array) -> bool:
    return bool(abs(direction[0]) + abs(direction[1]) + abs(direction[2]) < 0.1)


@njit(cache=True)
def _turn(rotations: Array, nodes: Array, pivot: Array, point: Array, normal: Array, depth: float) -> None:
    """Turn segments about a pivot so that a point moves along a direction."""
    rx, ry, rz = point[0] - pivot[0], point[1] - pivot[1], point[2] - pivot[2]
    factor = depth / max(rx * rx + ry * ry + rz * rz, 0.01)
    x = factor * (ry * normal[2] - rz * normal[1])
    y = factor * (rz * normal[0] - rx * normal[2])
    z = factor * (rx * normal[1] - ry * normal[0])
    angle = np.sqrt(x * x + y * y + z * z)
    if angle < 1e-9:
        return
    x, y, z = x / angle, y / angle, z / angle
    c, s = np.cos(angle), np.sin(angle)
    d = 1.0 - c
    for n in nodes:
        for k in range(3):
            p, q, r = rotations[n, 0, k], rotations[n, 1, k], rotations[n, 2, k]
            along = d * (x * p + y * q + z * r)
            rotations[n, 0, k] = c * p + s * (y * r - z * q) + along * x
            rotations[n, 1, k] = c * q + s * (z * p - x * r) + along * y
            rotations[n, 2, k] = c * r + s * (x * q - y * p) + along * z


@njit(cache=True)
def _arm_segments(rotations: Array, rest: Array, at: Array, side: int, ends: Array) -> None:
    """Fill the arm's three capsules: the outer half of the upper arm, forearm, hand."""
    shoulder, elbow, wrist = _ARMS[side, 0], _ARMS[side, 1], _ARMS[side, 2]
    for k in range(3):
        ends[0, 0, k] = 0.5 * (at[shoulder, k] + at[elbow, k])
        ends[0, 1, k] = ends[1, 0, k] = at[elbow, k]
        ends[1, 1, k] = ends[2, 0, k] = at[wrist, k]
        reach = 0.0
        for m in range(3):
            reach += rotations[wrist, k, m] * (rest[wrist, m] - rest[elbow, m])
        ends[2, 1, k] = at[wrist, k] + 0.40 * reach


@njit(cache=True)
def _push_arm(
    rotations: Array,
    rest: Array,
    at: Array,
    side: int,
    blocks: Array,
    radii: Array,
    mine: Array,
    other: Array,
) -> float:
    """Correct one arm by its deepest contact; return that depth."""
    point, normal = np.empty(3), np.empty(3)
    best_point, best_normal = np.empty(3), np.empty(3)
    deepest = 0.0
    _arm_segments(rotations, rest, at, side, mine)
    _arm_segments(rotations, rest, at, 1 - side, other)
    own = (_UPPER, _FORE, _HAND)
    for i in range(3):
        for j in range(_OBSTACLES):
            depth = _depth(
                mine[i, 0], mine[i, 1], blocks[j, 0], blocks[j, 1], own[i] + radii[j], point, normal
            )
            if depth > deepest:
                deepest = depth
                _copy(point, best_point)
                _copy(normal, best_normal)
        for j in range(2 if i == 2 else 3):
            # Hands may touch hands; forearms and upper arms of the two sides may not enter.
            depth = _depth(
                mine[i, 0], mine[i, 1], other[j, 0], other[j, 1], own[i] + own[j] - _OVERLAP, point, normal
            )
            if depth > deepest:
                deepest = depth
                _copy(point, best_point)
                _copy(normal, best_normal)
    if deepest > _TOUCH:
        # A deep arm is moved to its own side: the shortest way out no longer tells where it came from, and a
        # swinging hand would jump from front to back.
        outward = min(deepest / _FAR_INSIDE, 1.0) * (0.8 if side == 0 else -0.8)
        for k in range(3):
            best_normal[k] += outward * rotations[_CHEST, k, 0]
        size = np.sqrt(best_normal[0] ** 2 + best_normal[1] ** 2 + best_normal[2] ** 2)
        for k in range(3):
            best_normal[k] /= max(size, 1e-6)
        _turn(rotations, _ARMS[side], at[_ARMS[side, 0]], best_point, best_normal, deepest + _SLACK)
    return deepest


@njit(cache=True)
def _push_legs(rotations: Array, at: Array) -> float:
    """Correct both legs by their deepest contact with each other."""
    point, normal = np.empty(3), np.empty(3)
    best_point, best_normal = np.empty(3), np.empty(3)
    deepest = 0.0
    a, c = np.empty(3), np.empty(3)
    radii = (_THIGH - 0.01, _SHANK, _FOOT)
    for i in range(3):
        for j in range(3):
            # Only the lower halves of the thighs are tested.
            for k in range(3):
                a[k] = 0.5 * (at[_LEGS[0, 0], k] + at[_LEGS[0, 1], k]) if i == 0 else at[_LEGS[0, i], k]
                c[k] = 0.5 * (at[_LEGS[1, 0], k] + at[_LEGS[1, 1], k]) if j == 0 else at[_LEGS[1, j], k]
            depth = _depth(a, at[_LEGS[0, i + 1]], c, at[_LEGS[1, j + 1]], radii[i] + radii[j], point, normal)
            if depth > deepest:
                deepest = depth
                _copy(point, best_point)
                _copy(normal, best_normal)
    if deepest > _TOUCH:
        if _is_zero(best_normal):
            _copy(rotations[_PELVIS, :, 0], best_normal)  # the bones cross: apart to the sides
        half = 0.5 * (deepest + _SLACK)
        _turn(rotations, _LEGS[0], at[_LEGS[0, 0]], best_point, best_normal, half)
        _turn(rotations, _LEGS[1], at[_LEGS[1, 0]], best_point, best_normal, -half)
    return deepest


@njit(cache=True)
def push_apart(rotations: Array, rest: Array, rounds: int) -> Array:
    """Correct poses in place; returns each pose's deepest penetration before its last correction."""
    left = np.zeros(rotations.shape[0])
    at = np.empty((21, 3))
    blocks, radii = np.empty((_OBSTACLES, 2, 3)), np.empty(_OBSTACLES)
    mine, other = np.empty((3, 2, 3)), np.empty((3, 2, 3))
    for n in range(rotations.shape[0]):
        for _ in range(rounds):
            _positions(rotations[n], rest, at)
            depth = _push_legs(rotations[n], at)
            if depth > _TOUCH:
                _positions(rotations[n], rest, at)
            _obstacles(rotations[n], at, blocks, radii)
            for side in range(2):
                depth = max(depth, _push_arm(rotations[n], rest, at, side, blocks, radii, mine, other))
                _positions(rotations[n], rest, at)
            left[n] = depth
            if depth < 1e-3:
                break
    return left
