"""Motions of tests of function: a straight walk, rising from a chair, standing still.

They are simulated for `depth_pose.analysis`; what is known of them comes with them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from depth_pose.motion.clip import Clip
from depth_pose.motion.procedural import legs
from depth_pose.motion.procedural.draw import Draw, assemble
from depth_pose.motion.procedural.gait import gait_arms, gait_legs
from depth_pose.motion.procedural.generator import clip_from_motion
from depth_pose.motion.procedural.parts import looks_around, still

Array = NDArray[np.float64]

_RISE_S, _PAUSE_S = 1.2, 0.8
"""Durations of rising and sitting down, and of the pauses between them, seconds."""
_SEAT_M = 0.50
"""Height of the pelvis of the seated 1.75 m body, metres."""
_FORWARD_DEG = 35.0
"""Forward lean of the trunk while rising, degrees."""


def walk_straight(
    fps: float, seconds: float, seed: int = 0, *, cadence: float | None = None, size: float | None = None
) -> Clip:
    """Make a straight walk along +z at a constant cadence.

    Parameters
    ----------
    fps, seconds : float
    seed : int
        Of posture, arm swing and asymmetry.
    cadence : float, optional
        Steps a minute; drawn from 85 to 120 by default. The left foot touches down when
        ``cadence / 120 * t`` is a whole number.
    size : float, optional
        Length of the steps relative to the average; drawn from .7 to 1.2 by default.
    """
    draw = Draw(np.random.default_rng([seed, 17]), ())
    cadence = float(draw.uniform(85.0, 120.0)) if cadence is None else cadence
    size = float(draw.uniform(0.7, 1.2)) if size is None else size
    t = np.arange(max(round(fps * seconds), 2)) / fps
    phase = cadence / 120.0 * t
    trunk, leg = gait_legs(phase, draw, np.asarray(size))
    arms = gait_arms(phase, draw, np.asarray(size))
    trunk[..., 2] -= trunk[..., 2].mean()
    return clip_from_motion("walk_straight", still(assemble(t, trunk, arms, leg)), fps, stays=False)


def sit_to_stand(fps: float, seconds: float, seed: int = 0) -> Clip:
    """Make somebody who rises from a chair and sits down again, over and over, arms crossed or hanging."""
    draw = Draw(np.random.default_rng([seed, 18]), ())
    t = np.arange(max(round(fps * seconds), 2)) / fps
    up = _rising(t)
    drop = (legs.STANDING_M - _SEAT_M) * (1.0 - up)
    lean = _FORWARD_DEG * np.sin(np.pi * up) + 5.0 * (1.0 - up)
    zero = np.zeros_like(t)
    back = -0.36 * (1.0 - up)  # the pelvis is behind the feet
    width = 0.15 + zero
    lower = legs.lower_body(
        np.stack([0.4 * lean, zero, zero], axis=-1), legs.STANDING_M - 0.01 - drop,
        np.stack([width, zero, -back], axis=-1), np.stack([-width, zero, -back], axis=-1),
        np.stack([8 + zero, 8 + zero], axis=-1), np.stack([zero, zero], axis=-1), 0.6 * lean,
    )  # fmt: skip
    arms = np.zeros((*t.shape, 18))
    for c in (0, 9):
        arms[..., c + 2], arms[..., c + 3], arms[..., c + 5] = (
            15.0 + 20.0 * (1 - up),
            8.0,
            25.0 + 40.0 * (1 - up),
        )
    trunk = lower[..., :15] + 0.3 * looks_around(t, draw)
    return clip_from_motion(
        "sit_to_stand", still(assemble(t, trunk, arms, lower[..., 15:])), fps, stays=False
    )


def _rising(t: Array) -> Array:
    """Progress from sitting (0) to standing (1) over time: sit, rise, stand, sit down."""
    part = np.mod(t, 2 * (_RISE_S + _PAUSE_S))
    rise = np.clip((part - _PAUSE_S) / _RISE_S, 0.0, 1.0)
    fall = np.clip((part - 2 * _PAUSE_S - _RISE_S) / _RISE_S, 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * rise) - (0.5 - 0.5 * np.cos(np.pi * fall)))


def stand_still(fps: float, seconds: float, seed: int = 0) -> Clip:
    """Make somebody who stands still and sways by a few millimetres, about the ankles."""
    draw = Draw(np.random.default_rng([seed, 19]), ())
    t = np.arange(max(round(fps * seconds), 2)) / fps
    zero = np.zeros_like(t)
    forward, aside = (
        sum(a * np.sin(2 * np.pi * (f * t + float(draw.uniform(0, 1)))) for a, f in parts)
        for parts in (((6e-3, 0.15), (3e-3, 0.45)), ((3e-3, 0.2), (2e-3, 0.5)))
    )
    height = legs.STANDING_M - 0.015 + zero
    lower = legs.lower_body(
        np.stack([zero + 2, zero, zero], axis=-1), height,
        np.stack([0.11 - aside, zero, -forward], axis=-1), np.stack([-0.11 - aside, zero, -forward], axis=-1),
        np.stack([8 + zero, 8 + zero], axis=-1), np.stack([zero, zero], axis=-1), zero + 2,
    )  # fmt: skip
    arms = np.zeros((*t.shape, 18))
    for c in (0, 9):
        arms[..., c + 2], arms[..., c + 3], arms[..., c + 5] = 2.0, 8.0, 12.0
    return clip_from_motion(
        "stand_still", still(assemble(t, lower[..., :15], arms, lower[..., 15:])), fps, stays=False
    )


FUNCTION_CLIPS: dict[str, Callable[..., Clip]] = {
    "walk_straight": walk_straight,
    "sit_to_stand": sit_to_stand,
    "stand_still": stand_still,
}
"""Motions of tests of function by name, called with ``fps, seconds, seed``."""
