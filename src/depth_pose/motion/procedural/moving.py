"""Locomotion: walking, running, turning, side steps, crouching, sitting."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.motion.procedural import arms as arms
from depth_pose.motion.procedural import legs as legs
from depth_pose.motion.procedural.draw import Draw, assemble, harmonic, wander
from depth_pose.motion.procedural.gait import gait_arms, gait_legs, turning
from depth_pose.motion.procedural.parts import Motion, either_side, join, looks_around, still

Array = NDArray[np.float64]


def gait(t: Array, draw: Draw, run: bool) -> tuple[Array, Array, Array, Array, Array]:
    """Draw a gait: its phase, step size, trunk, legs and swinging arms."""
    size = draw.uniform(0.45, 1.35) if not run else draw.uniform(0.5, 1.25)
    rate = (0.55 + 0.4 * size) if not run else draw.uniform(1.15, 1.6)
    phase = rate * t + draw.uniform(0, 1)
    trunk, leg = gait_legs(phase, draw, size, run)
    upper = gait_arms(phase, draw, size, run)
    return phase, size, trunk, leg, upper


def walk(t: Array, draw: Draw) -> Motion:
    """Walk in a circle, arms swinging."""
    _, _, trunk, leg, swing = gait(t, draw, run=False)
    trunk = trunk + looks_around(t, draw, 14, 4)
    trunk[..., 2] += turning(t, draw, 21.0, 35.0)
    return still(assemble(t, trunk, swing, leg))


def walk_gesture(t: Array, draw: Draw) -> Motion:
    """Walk while gesturing, carrying, telephoning."""
    _, _, trunk, leg, swing = gait(t, draw, run=False)
    upper = wander(draw, t, arms.free_arms, 1.0, 1.2)
    busy = draw.chance(0.55)
    # Often one arm is busy and the other swings.
    upper[..., 9:] = np.where(busy[..., None], swing[..., 9:], upper[..., 9:])
    trunk = trunk + looks_around(t, draw, 20, 6)
    trunk[..., 2] += turning(t, draw, 15.0, 40.0)
    return still(assemble(t, trunk, upper, leg))


def run(t: Array, draw: Draw) -> Motion:
    """Run or jog, with the flight between the steps."""
    phase, size, trunk, leg, upper = gait(t, draw, run=True)
    trunk = trunk + looks_around(t, draw, 12, 5)
    trunk[..., 2] += turning(t, draw, 30.0, 70.0)
    flight = np.maximum(harmonic(2 * phase, ((0, 0), (25, 0), (70, 0.5), (86, 1.0)), 4), 0.0)
    return Motion(assemble(t, trunk, upper, leg), 0.06 * size * flight)


def side_step(t: Array, draw: Draw) -> Motion:
    """Shuffle sideways or jump apart and together, arms low or rising (jumping jack)."""
    angle = 2 * np.pi * (draw.uniform(0.6, 1.4) * t + draw.uniform(0, 1))
    width = 0.5 - 0.5 * np.cos(angle)
    zero = np.zeros_like(width)
    half = draw.uniform(0.07, 0.13) + draw.uniform(0.1, 0.32) * width
    drop = draw.uniform(0.03, 0.22) + 0.08 * width
    lean = draw.uniform(0, 25) + zero
    lower = legs.lower_body(
        np.stack([0.5 * lean, zero, zero], axis=-1), legs.STANDING_M - drop,
        np.stack([half, zero, zero], axis=-1), np.stack([-half, zero, zero], axis=-1),
        np.stack([12 + zero, 12 + zero], axis=-1), np.stack([15 * width, 15 * width], axis=-1), 0.5 * lean,
    )  # fmt: skip
    upper = wander(draw, t, arms.both(arms.low_arm, 0.6), 1.0, 0.5)
    jack = draw.chance(0.45)[..., None]
    raised = np.zeros((*t.shape, 18))
    for c in (0, 9):
        raised[..., c + 3] = 12 + draw.uniform(70, 160) * width
        raised[..., c + 4], raised[..., c + 5] = -10.0, draw.uniform(5, 40)
    lift = 0.06 * np.maximum(np.cos(2 * angle) * -1.0, 0.0) * draw.chance(0.5)
    return Motion(join(t, draw, lower, np.where(jack, raised, upper)), lift)


def lunges(t: Array, draw: Draw) -> Motion:
    """Step into lunges, arms free."""
    lower = wander(draw, t, lambda d: d.mix([legs.lunge, legs.stand], [3, 1], legs.LOWER), 0.9, 0.5)
    return still(either_side(draw, join(t, draw, lower, wander(draw, t, arms.free_arms))))


def squats(t: Array, draw: Draw) -> Motion:
    """Crouch and squat, arms free or forward."""
    lower = wander(
        draw, t, lambda d: d.mix([legs.crouch, legs.stand, legs.kneel], [4, 1, 0.4], legs.LOWER), 1.1, 0.4
    )
    return still(join(t, draw, lower, wander(draw, t, arms.free_arms)))


def bends(t: Array, draw: Draw) -> Motion:
    """Bend, bow and pick things up."""
    lower = wander(draw, t, lambda d: d.mix([legs.bend, legs.stand], [4, 1], legs.LOWER), 1.3, 0.5)
    low = [arms.both(arms.low_arm, 0.7), arms.both(arms.forward_straight, 0.7), arms.free_arms, arms.together]
    return still(join(t, draw, lower, wander(draw, t, lambda d: d.mix(low, [3, 2, 1, 1], 18))))


def sit_down(t: Array, draw: Draw) -> Motion:
    """Sit, gesture, and stand up again."""
    lower = wander(draw, t, lambda d: d.mix([legs.sit, legs.stand], [3, 1], legs.LOWER), 1.4, 1.2)
    return still(join(t, draw, lower, wander(draw, t, arms.free_arms)))


def balance(t: Array, draw: Draw) -> Motion:
    """Stand on one leg, lift a knee, step over things; stand on tiptoe."""
    options = [legs.one_leg, legs.stand, legs.tiptoe]
    lower = wander(draw, t, lambda d: d.mix(options, [4, 1, 0.7], legs.LOWER), 0.9, 0.4)
    return still(either_side(draw, join(t, draw, lower, wander(draw, t, arms.free_arms))))


def turn_on_spot(t: Array, draw: Draw) -> Motion:
    """Turn on the spot with small steps."""
    _, _, trunk, leg, _ = gait(t, draw, run=False)
    leg = 0.55 * leg
    trunk = 0.7 * trunk + looks_around(t, draw, 30, 4)
    trunk[..., 2] += turning(t, draw, 45.0, 110.0)
    return still(assemble(t, trunk, wander(draw, t, arms.both(arms.low_arm, 0.6), 1.0, 1.0), leg))
