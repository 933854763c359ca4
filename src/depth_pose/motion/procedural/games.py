"""Motions of games: kick, throw, racket, punch, basketball, jump, and free play."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import ANGLE_INDEX, ARM, TRUNK
from depth_pose.motion.procedural import arms as arms
from depth_pose.motion.procedural import legs as legs
from depth_pose.motion.procedural import tables as tables
from depth_pose.motion.procedural.draw import Draw, keyed, wander
from depth_pose.motion.procedural.moving import gait
from depth_pose.motion.procedural.parts import Motion, either_side, join, looks_around, still

Array = NDArray[np.float64]


def _action(
    t: Array, draw: Draw, table: tables.Table, seconds: tuple[float, float], rest_s: float = 0.5
) -> tuple[Array, Array]:
    """Repeat an action with a random amplitude; return angles and phase."""
    length = draw.uniform(*seconds)
    period = length + rest_s
    phase = np.clip(((t / period + draw.uniform(0, 1)) % 1.0) * period / length, 0.0, 1.0)
    angles = keyed(phase, table)
    size = np.repeat(draw.uniform(0.65, 1.15)[..., None], angles.shape[-1], axis=-1)
    size[..., ARM[0].start : ARM[1].stop] = draw.uniform(0.7, 1.15)[..., None]
    out = angles * size + 0.6 * _widen(draw)
    # The amplitude scales all angles, and so the first key's stance as well.
    out[..., TRUNK] += 0.5 * looks_around(t, draw, 14, 8)
    return out, phase


def _widen(draw: Draw) -> Array:
    out = np.zeros((*draw.shape, 47))
    for name, spread in (
        ("shoulder_flexion", 14), ("shoulder_abduction", 12), ("shoulder_twist", 16), ("elbow_flexion", 16),
        ("hip_flexion", 9), ("hip_abduction", 5), ("hip_twist", 6), ("knee_flexion", 11),
        ("ankle_dorsiflexion", 6),
    ):  # fmt: skip
        for side in ("left", "right"):
            out[..., ANGLE_INDEX[f"{side}_{name}"]] = draw.normal(0, spread)
    return out


def kick(t: Array, draw: Draw) -> Motion:
    """Kick a ball with either foot."""
    return still(either_side(draw, _action(t, draw, tables.KICK, (1.0, 1.6))[0]))


def throw(t: Array, draw: Draw) -> Motion:
    """Throw over-arm with a step."""
    return still(either_side(draw, _action(t, draw, tables.THROW, (1.1, 1.8))[0]))


def racket(t: Array, draw: Draw) -> Motion:
    """Swing a racket or bat across the body."""
    return still(either_side(draw, _action(t, draw, tables.RACKET, (1.1, 1.9), 0.3)[0]))


def punch(t: Array, draw: Draw) -> Motion:
    """Box: guard, jab, cross, hook."""
    return still(either_side(draw, _action(t, draw, tables.PUNCH, (1.2, 2.2), 0.1)[0]))


def shoot(t: Array, draw: Draw) -> Motion:
    """Shoot at a basket."""
    angles, phase = _action(t, draw, tables.SHOOT, (1.1, 1.7))
    air = np.clip((phase - 0.5) / 0.26, 0, 1)
    return Motion(either_side(draw, angles), draw.uniform(0.0, 0.3) * 4 * air * (1 - air))


def jump(t: Array, draw: Draw) -> Motion:
    """Jump up from a crouch, arms swinging."""
    angles, phase = _action(t, draw, tables.JUMP, (1.2, 1.7))
    start, end = tables.JUMP_AIR
    air = np.clip((phase - start) / (end - start), 0, 1)
    return Motion(angles, draw.uniform(0.08, 0.45) * 4 * air * (1 - air))


def dribble(t: Array, draw: Draw) -> Motion:
    """Bounce a ball with one hand, standing low or walking."""
    lower = wander(
        draw, t, lambda d: d.mix([legs.stand_wide, legs.crouch, legs.lunge], [2, 3, 1], legs.LOWER), 0.7, 0.5
    )
    _, _, trunk, leg, _ = gait(t, draw, run=False)
    moving = draw.chance(0.5)[..., None]
    lower = np.where(moving, np.concatenate([trunk, leg], axis=-1), lower)
    angle = 2 * np.pi * (draw.uniform(1.2, 2.2) * t + draw.uniform(0, 1))
    push = 0.5 + 0.5 * np.cos(angle)
    upper = np.zeros((*t.shape, 18))
    upper[..., :9] = wander(draw, t, arms.both(arms.low_arm, 0.5), 0.8, 0.6)[..., :9]
    upper[..., 11] = draw.normal(22, 16) + 12 * push
    upper[..., 12] = draw.normal(22, 10)
    upper[..., 13] = draw.normal(-2, 32)
    upper[..., 14] = draw.normal(40, 16) + draw.uniform(20, 45) * push
    upper[..., 15] = 70.0
    upper[..., 16] = 30 - 45 * push
    lower[..., 3] += draw.pick(0, 20, 1.2)
    lower[..., 6] += draw.pick(0, 14, 1.2)
    return still(either_side(draw, join(t, draw, lower, upper)))


def _sport(draw: Draw) -> Array:
    return draw.mix([legs.stand_wide, legs.crouch, legs.lunge, legs.one_leg], [3, 3, 1.5, 1.0], legs.LOWER)


def play(t: Array, draw: Draw) -> Motion:
    """Move as in a game: low wide stances and steps with any arms, hands on a ball."""
    lower = wander(draw, t, _sport, 0.6, 0.3)
    upper = wander(draw, t, arms.free_arms, 0.7, 0.4)
    return still(either_side(draw, join(t, draw, lower, upper, looks_around(t, draw, 28, 10))))
