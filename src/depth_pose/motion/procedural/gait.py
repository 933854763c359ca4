"""Walking and running as harmonic series of joint angles over the gait cycle.

The control points are read off published average curves and rounded: walking after D. A. Winter,
*The Biomechanics and Motor Control of Human Gait*, 2nd ed., 1991 (natural cadence) and J. Perry,
*Gait Analysis: Normal and Pathological Function*, 1992 (pelvis, hip adduction); running after
T. F. Novacheck, *The biomechanics of running*, Gait and Posture 7, 1998; arm swing after
M. P. Murray et al., *Patterns of sagittal rotation of the upper limbs in walking*, Phys. Ther. 47,
1967. 0 % is a foot's contact with the floor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import rotations_from_angles
from depth_pose.motion.contact import support_points
from depth_pose.motion.procedural.draw import Draw, assemble, harmonic, sway

Array = NDArray[np.float64]

WALK_HIP = ((0, 26), (10, 23), (20, 14), (30, 5), (40, -4), (50, -10), (58, -6), (70, 14), (82, 27), (92, 29))
"""Hip flexion in walking: percent of the cycle, degrees."""
WALK_KNEE = (
    (0, 4),
    (8, 13),
    (15, 18),
    (25, 13),
    (38, 5),
    (50, 14),
    (60, 38),
    (70, 63),
    (78, 58),
    (88, 24),
    (96, 2),
)
"""Knee flexion in walking: percent of the cycle, degrees."""
WALK_ANKLE = ((0, 0), (7, -6), (15, 0), (30, 6), (45, 11), (52, 6), (62, -18), (70, -9), (80, 1), (90, 2))
"""Dorsiflexion of the ankle in walking: percent of the cycle, degrees."""
WALK_ABDUCTION = ((0, 0), (15, -6), (30, -5), (50, -2), (62, 6), (75, 5), (90, 1))
"""Hip abduction in walking: percent of the cycle, degrees."""
SWING = ((0, 0), (52, 0), (70, 0.8), (84, 1), (94, 0.6), (99, 0))
"""Progress of a walker's foot through its swing: percent of the cycle, 0 to 1."""
RUN_HIP = ((0, 38), (15, 26), (30, 4), (40, -8), (50, -4), (65, 28), (80, 54), (90, 50))
"""Hip flexion in running: percent of the cycle, degrees."""
RUN_KNEE = (
    (0, 18),
    (10, 38),
    (18, 42),
    (30, 24),
    (38, 18),
    (50, 55),
    (65, 100),
    (72, 98),
    (85, 52),
    (95, 20),
)
"""Knee flexion in running: percent of the cycle, degrees."""
RUN_ANKLE = ((0, 6), (10, 20), (18, 25), (30, 0), (40, -24), (50, -12), (65, 2), (80, 6))
"""Dorsiflexion of the ankle in running: percent of the cycle, degrees."""
RUN_ABDUCTION = ((0, -4), (15, -8), (35, -2), (50, 4), (70, 4), (90, -2))
"""Hip abduction in running: percent of the cycle, degrees."""


def _leg(phase: Array, draw: Draw, size: Array, bounce: Array, run: bool) -> Array:
    hip, knee, ankle, side = (
        (RUN_HIP, RUN_KNEE, RUN_ANKLE, RUN_ABDUCTION)
        if run
        else (WALK_HIP, WALK_KNEE, WALK_ANKLE, WALK_ABDUCTION)
    )
    out = np.zeros((*phase.shape, 7))
    out[..., 0] = size * harmonic(phase, hip) + (1 - size) * 8 + bounce - 2.0
    # Steps of a straight path stay under the body; those of a turn or a feint cross or spread.
    wide = np.maximum(draw.normal(0.0, 1.0) * draw.pick(1.0, 15.0, 3.0), -5.0)
    out[..., 1] = 0.8 * harmonic(phase, side) + (-0.5 if run else 1.5) + wide
    out[..., 2] = draw.normal(-2, 5)
    swing = harmonic(phase, knee)
    out[..., 3] = np.maximum(swing * (0.35 + 0.65 * size) + 2.0 * bounce, 0.0)
    out[..., 4] = (0.4 + 0.6 * size) * harmonic(phase, ankle) + bounce
    if not run:
        # A short step swings less; the foot still has to clear the floor.
        clear = np.maximum(harmonic(phase, SWING, 4), 0.0) * np.clip(1.35 - size, 0.0, 1.0)
        out[..., 0] += 14.0 * clear
        out[..., 3] += 26.0 * clear
        out[..., 4] += 8.0 * clear
    out[..., 6] = draw.normal(2 if run else 5, 6)
    return out


def gait_legs(phase: Array, draw: Draw, size: Array, run: bool = False) -> tuple[Array, Array]:
    """Trunk and legs at a phase of the gait cycle.

    Parameters
    ----------
    phase : (T,)
        Cycles; the left foot touches down at whole numbers.
    draw : Draw
    size : (...)
        Length of the steps relative to the published average (0.3 shuffling, 1.3 striding).
    run : bool

    Returns
    -------
    trunk : (T, 15) float64
    legs : (T, 14) float64
        Degrees.
    """
    bounce = draw.pick(0.0, 12.0, 2.0)
    legs = np.concatenate(
        [_leg(phase, draw, size, bounce, run), _leg(phase + 0.5, draw, size, bounce, run)], axis=-1
    )
    trunk = np.zeros((*phase.shape, 15))
    turn, list_, twice = 2 * np.pi * phase, 2 * np.pi * (phase - 0.02), 4 * np.pi * phase
    # The pelvis turns forward with the swinging leg and drops on its side; the chest turns against it.
    pelvis_turn = -size * (5.0 if not run else 7.0) * np.cos(turn)
    trunk[..., 2] = pelvis_turn
    trunk[..., 1] = -size * (3.5 if not run else 4.5) * np.sin(list_)
    trunk[..., 0] = (draw.normal(4, 4) if not run else draw.normal(10, 6)) + 1.5 * np.cos(twice)
    counter = (2.0 if not run else 2.4) + draw.normal(0, 0.4)
    trunk[..., 5], trunk[..., 8] = -0.4 * counter * pelvis_turn, -0.6 * counter * pelvis_turn
    trunk[..., 4] = trunk[..., 7] = -0.5 * trunk[..., 1]
    trunk[..., 1] += draw.normal(0, 1.0) * draw.pick(1.0, 16.0 if run else 8.0, 2.5)
    # A runner who speeds up leans into it, one who brakes leans back.
    lean = draw.normal(3, 6) if not run else draw.normal(6, 7) + draw.pick(0, 34, 2.2) - draw.pick(0, 32, 4.0)
    if run:
        trunk[..., 0] += draw.pick(0, 25, 2.5) - draw.pick(0, 15, 3.5)
        leg_reach = draw.pick(0, 14, 2.0) - 3.0
        legs[..., [0, 7]] += np.asarray(leg_reach)[..., None]
    trunk[..., 3], trunk[..., 6] = 0.5 * lean, 0.5 * lean
    trunk[..., 9] = trunk[..., 12] = -0.3 * lean + draw.normal(3, 6)
    trunk[..., 11] = trunk[..., 14] = -0.5 * (1 - counter) * pelvis_turn
    return trunk, legs if run else _clear_the_floor(phase, trunk, legs)


def _clear_the_floor(phase: Array, trunk: Array, legs: Array) -> Array:
    """Bend a walker's swinging leg until its foot is above the standing one, (T, 14)."""
    out = legs.copy()
    windows = [np.maximum(harmonic(phase + 0.5 * side, SWING, 4), 0.0) for side in (0, 1)]
    for _ in range(3):
        points = support_points(rotations_from_angles(assemble(phase, trunk, None, out)))[..., 1]
        lowest = [points[..., :3].min(axis=-1), points[..., 4:7].min(axis=-1)]
        for side, window in enumerate(windows):
            missing = np.clip(lowest[1 - side] + 0.015 * window - lowest[side], 0.0, 0.1)
            # A knee bent by a radian more shortens a leg that swings by about 0.25 m.
            bend = np.degrees(missing / 0.25) * np.minimum(3.0 * window, 1.0)
            out[..., 7 * side] += 0.5 * bend
            out[..., 7 * side + 3] += bend
            out[..., 7 * side + 4] += 0.3 * bend
    return out


def gait_arms(phase: Array, draw: Draw, size: Array, run: bool = False) -> Array:
    """Both arms swinging against the legs, (T, 18) degrees."""
    out = np.zeros((*phase.shape, 18))
    bent = draw.normal(22, 13) if not run else draw.normal(95, 20)
    swing = draw.normal(15, 6) * size if not run else draw.normal(32, 10) * (0.5 + 0.5 * size)
    aside = draw.normal(9, 4) if not run else draw.normal(10, 7)
    inward = draw.normal(18, 14) if not run else draw.normal(28, 14)
    back = draw.normal(-2, 6) if not run else draw.normal(-20, 11)
    for side in (0, 1):
        c = 9 * side
        # The left arm is farthest back as the left foot touches down.
        wave = -np.cos(2 * np.pi * (phase + 0.5 * side - 0.03))
        own = swing * draw.uniform(0.75, 1.25)
        out[..., c + 2] = back + draw.normal(3, 3) + own * wave
        out[..., c + 3] = aside + draw.normal(0, 2)
        out[..., c + 4] = inward + draw.normal(0, 6) + (0.4 * own * wave if run else 0.0)
        out[..., c + 5] = np.maximum(bent + draw.normal(0, 5) + own * (0.5 if not run else 0.35) * wave, 3.0)
        out[..., c + 6] = draw.normal(20, 25)
        out[..., c + 7] = draw.normal(8, 8)
        out[..., c] = draw.normal(0, 2)
    return out


def turning(t: Array, draw: Draw, low: float, high: float) -> Array:
    """Heading in degrees of a person who changes direction now and then, (T,)."""
    rate = draw.uniform(low, high) * np.where(draw.chance(0.5), 1.0, -1.0)
    return rate * t + sway(draw, t, 12.0, 0.1)
