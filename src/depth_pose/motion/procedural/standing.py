"""Motions of a standing person: gestures, signals, reaching, holding, wiping."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import ARM
from depth_pose.motion.procedural import arms as arms
from depth_pose.motion.procedural import legs as legs
from depth_pose.motion.procedural.draw import Draw, wander
from depth_pose.motion.procedural.parts import Motion, join, looks_around, standing, still
from depth_pose.motion.reach import arm_to_target

Array = NDArray[np.float64]


def stand_casual(t: Array, draw: Draw) -> Motion:
    """Stand about, arms low, shifting weight."""
    lower = wander(draw, t, standing, 1.2, 2.0)
    return still(join(t, draw, lower, wander(draw, t, arms.both(arms.low_arm, 0.6), 1.0, 1.6)))


def stand_gesture(t: Array, draw: Draw) -> Motion:
    """Stand and gesture with one arm or both."""
    lower = wander(draw, t, standing, 1.2, 2.0)
    return still(join(t, draw, lower, wander(draw, t, arms.free_arms)))


def reach_around(t: Array, draw: Draw) -> Motion:
    """Reach over the whole workspace, the trunk following."""
    lower = wander(draw, t, standing, 1.2, 1.0)
    upper = wander(draw, t, arms.both(arms.reach, 0.25), 0.9, 0.3)
    looks = looks_around(t, draw, 30, 12)
    # The trunk turns and bends toward where the higher hand goes.
    for arm, sign in zip(ARM, (1.0, -1.0), strict=True):
        c = arm.start - 15
        away = np.clip((upper[..., c + 3] - 40) / 100, 0, 1) * draw.uniform(0, 1)
        looks[..., 4] += sign * 10 * away
        across = np.clip(-upper[..., c + 3] / 40, 0, 1) * draw.uniform(0, 1)
        looks[..., 8] -= sign * 25 * across
    return still(join(t, draw, lower, upper, looks))


def raise_arms(t: Array, draw: Draw) -> Motion:
    """Raise one arm or both sideways or forward and lower them again."""
    rate = draw.uniform(0.2, 0.6)
    progress = 0.5 - 0.5 * np.cos(2 * np.pi * (rate * t + draw.uniform(0, 1)))
    plane = draw.uniform(-0.15, 1.1)
    top = draw.uniform(80, 175)
    upper = np.zeros((*t.shape, 18))
    single = draw.chance(0.3)
    for side in (0, 1):
        size = (8 + (top - 8 + draw.normal(0, 6)) * progress) * np.where(single & (side == 1), 0.1, 1.0)
        c = 9 * side
        upper[..., c + 2] = size * np.sin(plane * np.pi / 2)
        upper[..., c + 3] = 6 + size * np.cos(plane * np.pi / 2)
        upper[..., c + 4] = draw.normal(0, 25) + 10
        upper[..., c + 5] = draw.pick(3, 70, 2.5)
    lower = wander(draw, t, standing, 1.2, 2.0)
    return still(join(t, draw, lower, upper))


def wave(t: Array, draw: Draw) -> Motion:
    """Wave with one hand, the other arm free."""
    upper = wander(draw, t, arms.both(arms.low_arm, 0.5), 1.0, 2.0)
    swing = np.sin(2 * np.pi * (draw.uniform(0.6, 2.2) * t + draw.uniform(0, 1)))
    upper[..., 2] = draw.normal(35, 25)
    upper[..., 3] = draw.normal(95, 25) + draw.uniform(0, 15) * swing
    upper[..., 4] = draw.normal(-75, 22) + draw.uniform(5, 32) * swing
    upper[..., 5] = draw.normal(75, 28) + draw.uniform(0, 28) * swing
    upper[..., 6] = draw.normal(-20, 30)
    lower = wander(draw, t, standing, 1.2, 2.0)
    return still(join(t, draw, lower, upper))


def _signal(draw: Draw) -> Array:
    one = [arms.aside_straight, arms.goal_post, arms.forward_straight, arms.overhead, arms.on_hip, arms.hang]
    one += [arms.crossed, arms.at_head]
    return arms.both(lambda d: d.mix(one, [3, 2.5, 2.5, 3, 1, 1.5, 0.8, 0.5], 9), 0.4)(draw)


def signals(t: Array, draw: Draw) -> Motion:
    """Direct traffic or referee: arms aside, up, forward, bent, with beckoning."""
    lower = wander(draw, t, legs.stand, 1.2, 2.0)
    upper = wander(draw, t, _signal, 0.6, 0.9)
    for side in (0, 1):
        beat = np.sin(2 * np.pi * (draw.uniform(0.5, 1.5) * t + draw.uniform(0, 1)))
        upper[..., 9 * side + 5] += draw.pick(0, 35, 3) * (1 + beat)
    return still(join(t, draw, lower, upper))


def crossed_arms(t: Array, draw: Draw) -> Motion:
    """Fold the arms, hold hands before or behind the body or behind the head, hands on hips."""
    both = [arms.both(s, 0.75) for s in (arms.on_hip, arms.behind_head, arms.behind_back, arms.before_belly)]
    upper = wander(draw, t, lambda d: d.mix([arms.folded, *both], [1.5, 2, 1, 1, 1.5], 18), 1.2, 2.5)
    return still(join(t, draw, wander(draw, t, standing, 1.2, 2.0), upper))


def hold_things(t: Array, draw: Draw) -> Motion:
    """Hold, lift and carry something with both hands."""
    return still(join(t, draw, wander(draw, t, standing, 1.2, 1.5), wander(draw, t, arms.together, 1.0, 0.6)))


def wash_window(t: Array, draw: Draw) -> Motion:
    """Wipe circles before the body with one hand."""
    angle = 2 * np.pi * (draw.uniform(0.3, 0.9) * t + draw.uniform(0, 1))
    centre = draw.vector((-0.02, 0.10, 0.36), (0.16, 0.26, 0.06))
    size = draw.vector((0.16, 0.16, 0.0), (0.10, 0.12, 0.0))
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    upper = np.zeros((*t.shape, 18))
    upper[..., :9] = arm_to_target(centre + size * circle, np.array([0.6, -0.75, -0.1]))
    upper[..., 9:] = wander(draw, t, arms.low_arm, 1.2, 2.0)
    return still(join(t, draw, wander(draw, t, standing, 1.5, 2.0), upper))
