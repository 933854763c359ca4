"""Leg postures: standing in many ways, crouching, lunging, sitting, one-legged.

A stance places the two feet and the pelvis, and the legs follow (`leg_to_target`). Trunk angles
come with it, because a low pelvis needs a forward lean to stay in balance. The ranges that a stance draws
from (metres on a 1.75 m body, degrees) are designed by hand, with ``benchmarks/banks.py coverage`` in view.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import trunk_rotation
from depth_pose.core.rotations import mirror_rotation
from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX, rest_nodes
from depth_pose.motion.procedural.draw import Draw
from depth_pose.motion.reach import leg_to_target

Array = NDArray[np.float64]

LOWER = 3 + 12 + 14
"""Number of angles of a lower-body posture: pelvis, spine to head, both legs."""

_AT = rest_nodes() * ADULT_STATURE_M
"""Nodes at rest of the 1.75 m body, (21, 3), metres."""
_HIP = _AT[NODE_INDEX["left_hip"]] - _AT[0]
"""From the pelvis to the left hip, metres."""
_ANKLE_M = float(_AT[NODE_INDEX["left_ankle"], 1])
"""Height of a standing person's ankles (m)."""
STANDING_M = float(_AT[0, 1])
"""Height of the pelvis at rest, metres."""
_BALL_M = 0.14
"""Vector from the ankle to the ball of the foot, the pivot of a raised heel (m)."""
_FLIP = np.array([-1.0, 1.0, 1.0])
"""Factor that mirrors a position left to right."""


def lower_body(
    pelvis: Array, height: Array, left: Array, right: Array, toe_out: Array, pitch: Array, lean: Array
) -> Array:
    """Compute the posture for given positions of the pelvis and the feet.

    Parameters
    ----------
    pelvis : (..., 3)
        Flexion, side bend and twist of the pelvis, degrees.
    height : (...)
        Pelvis above the floor, metres.
    left, right : (..., 3)
        Ankles: to the left of the pelvis, above the standing ankle, forward of it, metres.
    toe_out, pitch : (..., 2)
        Direction and attitude of the two feet, degrees.
    lean : (...)
        Forward bend of the trunk against the pelvis, degrees.

    Returns
    -------
    (..., 29) float64
        Pelvis, spine, chest, neck, head (15 angles), left leg, right leg (14), degrees.
    """
    rotation = trunk_rotation(pelvis[..., 0], pelvis[..., 1], pelvis[..., 2])
    out = np.zeros((*height.shape, LOWER))
    out[..., 0:3] = pelvis
    for i, share in ((1, 0.55), (2, 0.45)):
        out[..., 3 * i] = share * lean
        out[..., 3 * i + 1] = -0.5 * pelvis[..., 1]
    # The head keeps looking ahead: it takes back half of the lean.
    out[..., 9] = out[..., 12] = -0.25 * np.clip(pelvis[..., 0] + lean, -30, 60)
    for side, foot in enumerate((left, right)):
        hip = (rotation @ (_HIP if side == 0 else _HIP * _FLIP)[:, None])[..., 0]
        ankle = np.stack([foot[..., 0], foot[..., 1] + _ANKLE_M - height, foot[..., 2]], axis=-1) - hip
        flip = 1.0 if side == 0 else _FLIP
        turned = rotation if side == 0 else mirror_rotation(rotation)
        raised = np.maximum(pitch[..., side], 0.0)
        ankle[..., 1] += _BALL_M * np.sin(np.radians(raised))
        out[..., 15 + 7 * side : 22 + 7 * side] = leg_to_target(
            ankle * flip, toe_out[..., side], pitch[..., side], turned
        )
    return out


def _feet(draw: Draw, width: Array, stagger: Array) -> tuple[Array, Array]:
    shift = draw.uniform(-0.65, 0.65) * width
    zero = np.zeros(np.broadcast(width, stagger).shape)
    left = np.stack([width / 2 + shift, zero, stagger / 2], axis=-1)
    right = np.stack([-width / 2 + shift, zero, -stagger / 2], axis=-1)
    return left, right


def _pair(draw: Draw, low: float, high: float) -> Array:
    return np.stack([draw.uniform(low, high), draw.uniform(low, high)], axis=-1)


def _pelvis(draw: Draw, flexion: Array, side: float = 4.0, twist: float = 0.0) -> Array:
    return np.stack([flexion, draw.normal(0, side), draw.normal(0, twist)], axis=-1)


def stand(draw: Draw) -> Array:
    """Stand at ease: feet about hip-wide, weight on either foot, knees nearly straight."""
    width, stagger = draw.normal(0.28, 0.13), draw.normal(0.0, 0.10)
    left, right = _feet(draw, np.abs(width), stagger)
    drop = draw.pick(0.005, 0.06, 1.5) + 0.25 * (np.abs(width) - 0.22) ** 2
    return lower_body(
        _pelvis(draw, draw.normal(2, 4)), STANDING_M - drop, left, right,
        _pair(draw, -3, 26), np.zeros((*draw.shape, 2)), draw.normal(2, 5),
    )  # fmt: skip


def stand_wide(draw: Draw) -> Array:
    """Stand with the feet wide apart or one before the other, knees a little bent."""
    width, stagger = draw.uniform(0.15, 0.85), draw.uniform(-0.5, 0.5)
    left, right = _feet(draw, width, stagger)
    spread = np.hypot(np.maximum(width - 0.2, 0), stagger) / 2
    legs = 0.855 - draw.pick(0.0, 0.14, 1.3)
    height = _ANKLE_M + 0.01 + np.sqrt(np.maximum(legs**2 - spread**2, 0.2))
    back = np.stack([np.where(stagger > 0, 0, 1), np.where(stagger > 0, 1, 0)], axis=-1)
    heel = back * (np.maximum(np.abs(stagger) - 0.25, 0) * draw.uniform(0, 110))[..., None]
    return lower_body(
        _pelvis(draw, draw.normal(4, 6), 5, 5),
        height,
        left,
        right,
        _pair(draw, -5, 35),
        heel,
        draw.normal(4, 8),
    )


def crouch(draw: Draw) -> Array:
    """Stand ready or squat; the trunk leans more, the lower the pelvis is."""
    depth = draw.pick(0.08, 0.60, 1.8)
    left, right = _feet(draw, draw.uniform(0.2, 0.7), draw.normal(0, 0.15))
    lean = draw.uniform(0.2, 1.0) * depth / 0.5 * 60
    back = -0.25 * depth
    left[..., 2] -= back
    right[..., 2] -= back
    heel = np.maximum(depth - 0.4, 0) * draw.uniform(0, 120)
    pelvis = _pelvis(draw, 0.6 * lean, 3, 4)
    return lower_body(
        pelvis,
        STANDING_M - depth,
        left,
        right,
        _pair(draw, 2, 35),
        np.stack([heel, heel], axis=-1),
        0.6 * lean,
    )


def lunge(draw: Draw) -> Array:
    """Step far forward with the left foot, pelvis low."""
    step = draw.uniform(0.5, 1.05)
    forward = draw.uniform(0.35, 0.65) * step
    side = draw.normal(0.0, 0.18)
    zero = np.zeros(draw.shape)
    left = np.stack([0.10 + np.maximum(side, -0.1), zero, forward], axis=-1)
    right = np.stack([-0.12 + zero, zero, forward - step], axis=-1)
    height = STANDING_M - draw.uniform(0.10, 0.22) - 0.22 * step**2
    pitch = np.stack([zero, draw.uniform(20, 65)], axis=-1)
    return lower_body(
        _pelvis(draw, draw.normal(8, 7), 3, 10),
        height,
        left,
        right,
        _pair(draw, -5, 20),
        pitch,
        draw.normal(6, 9),
    )


def bend(draw: Draw) -> Array:
    """Bend down from hips and back, knees straight or bent."""
    angle = draw.uniform(25, 125)
    left, right = _feet(draw, draw.uniform(0.15, 0.5), draw.normal(0, 0.12))
    depth = draw.pick(0.01, 0.35, 2.0)
    back = 0.12 * np.sin(np.radians(np.minimum(angle, 90)))
    left[..., 2] += back
    right[..., 2] += back
    out = lower_body(
        _pelvis(draw, 0.55 * angle, 3, 4), STANDING_M - 0.02 - depth, left, right,
        _pair(draw, 0, 25), np.zeros((*draw.shape, 2)), 0.5 * angle,
    )  # fmt: skip
    out[..., [9, 12]] += draw.uniform(-12, 22)[..., None]
    return out


def sit(draw: Draw) -> Array:
    """Sit on a chair or stool, feet before it, leaning back or forward."""
    height = draw.uniform(0.44, 0.68)
    lean = draw.normal(8, 16)
    zero = np.zeros(draw.shape)
    spread, forward = draw.uniform(0.1, 0.3), draw.uniform(0.22, 0.55)
    left = np.stack([spread, zero, forward + draw.normal(0, 0.06)], axis=-1)
    right = np.stack([-spread + draw.normal(0, 0.04), zero, forward + draw.normal(0, 0.06)], axis=-1)
    return lower_body(
        _pelvis(draw, 0.5 * lean - 8, 2), height, left, right, _pair(draw, -3, 25),
        np.zeros((*draw.shape, 2)), 0.5 * lean + 6,
    )  # fmt: skip


def one_leg(draw: Draw) -> Array:
    """Stand on the right leg, the left knee raised, or the foot out in any direction."""
    kind = draw.uniform(0, 1)[..., None]
    zero = np.zeros(draw.shape)
    knee_up = np.stack([draw.uniform(0.02, 0.2), draw.uniform(0.1, 0.55), draw.uniform(-0.25, 0.35)], axis=-1)
    out_there = np.stack(
        [draw.uniform(-0.1, 0.6), draw.uniform(0.02, 0.35), draw.uniform(-0.5, 0.7)], axis=-1
    )
    left = np.where(kind < 0.5, knee_up, out_there)
    right = np.stack([-0.05 + zero, zero, zero], axis=-1)
    away = left[..., 2]
    pitch = np.stack([np.where(away < 0, 45, -5) + draw.normal(0, 12), zero], axis=-1)
    pelvis = np.stack([-10 * away + draw.normal(2, 4), draw.normal(-4, 4), draw.normal(0, 6)], axis=-1)
    return lower_body(
        pelvis, STANDING_M - draw.pick(0.01, 0.1, 1.5), left, right, _pair(draw, -5, 25), pitch,
        -8 * away + draw.normal(3, 6),
    )  # fmt: skip


def kneel(draw: Draw) -> Array:
    """Kneel on the right knee, the left foot before the body."""
    zero = np.zeros(draw.shape)
    left = np.stack([draw.uniform(0.05, 0.2), zero, draw.uniform(0.25, 0.45)], axis=-1)
    right = np.stack([-0.12 + zero, zero + 0.03, draw.uniform(-0.5, -0.38)], axis=-1)
    pitch = np.stack([zero, draw.uniform(50, 80)], axis=-1)
    return lower_body(
        _pelvis(draw, draw.normal(5, 8), 3, 4), draw.uniform(0.46, 0.56), left, right,
        _pair(draw, -5, 15), pitch, draw.normal(8, 10),
    )  # fmt: skip


def tiptoe(draw: Draw) -> Array:
    """Stand on the balls of the feet."""
    left, right = _feet(draw, draw.uniform(0.15, 0.35), draw.normal(0, 0.05))
    rise = draw.uniform(10, 45)
    height = STANDING_M - 0.015 + _BALL_M * np.sin(np.radians(rise))
    return lower_body(
        _pelvis(draw, draw.normal(0, 4)), height, left, right, _pair(draw, 0, 20),
        np.stack([rise, rise], axis=-1), draw.normal(-2, 5),
    )  # fmt: skip
