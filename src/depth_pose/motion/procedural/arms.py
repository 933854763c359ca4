"""Postures of one arm and of both: hanging, on the hip, crossed, behind the head, pointing, reaching.

Each sampler gives nine angles (`ARM_ANGLES`) for the left arm; the right one is its mirror image.
Places are metres on a 1.75 m body, relative to the shoulder in the chest's frame.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import FOREARM_M, UPPER_ARM_M
from depth_pose.motion.procedural.draw import Draw
from depth_pose.motion.reach import arm_to_target

Array = NDArray[np.float64]
Sampler = Callable[[Draw], Array]

ARM_M = UPPER_ARM_M + FOREARM_M
"""Shoulder to wrist of the 1.75 m body."""


def place(
    draw: Draw,
    target: tuple[float, float, float],
    spread: tuple[float, float, float],
    pole: tuple[float, float, float],
    pole_spread: float = 0.3,
) -> Array:
    """Move the wrist near a place, the elbow toward a pole."""
    out = arm_to_target(draw.vector(target, spread), draw.vector(pole, (pole_spread,) * 3))
    out[..., 6] = draw.normal(20, 25)
    out[..., 7] = draw.normal(8, 12)
    out[..., 0] = draw.normal(0, 2.5)
    return out


def _angles(draw: Draw, *mean_and_spread: tuple[float, float]) -> Array:
    """Shoulder flexion, abduction, twist, elbow flexion as normal draws."""
    out = np.zeros((*draw.shape, 9))
    for i, (mean, spread) in enumerate(mean_and_spread):
        out[..., 2 + i] = draw.normal(mean, spread)
    out[..., 5] = np.maximum(out[..., 5], 2.0)
    out[..., 6], out[..., 7], out[..., 0] = draw.normal(20, 25), draw.normal(8, 12), draw.normal(0, 2.5)
    return out


def hang(draw: Draw) -> Array:
    """Hang the arm, more or less relaxed."""
    return _angles(draw, (2, 9), (8, 6), (12, 18), (20, 13))


def hang_away(draw: Draw) -> Array:
    """Hold the arm slightly away from the body, as a gymnast does."""
    return _angles(draw, (4, 20), (32, 13), (15, 22), (35, 22))


def ready(draw: Draw) -> Array:
    """Hold forearm and hand before the body (typing, carrying, boxing guard, talking)."""
    return _angles(draw, (18, 22), (18, 14), (8, 36), (88, 27))


def on_hip(draw: Draw) -> Array:
    """Rest the hand on the hip."""
    return place(draw, (0.0, -0.40, 0.06), (0.05, 0.05, 0.06), (0.9, 0.1, -0.45), 0.25)


def behind_head(draw: Draw) -> Array:
    """Place the hand behind the head or on it."""
    return place(draw, (-0.09, 0.24, -0.02), (0.06, 0.09, 0.08), (0.9, 0.5, 0.1), 0.35)


def at_head(draw: Draw) -> Array:
    """Hold the hand at ear, brow, mouth or chin (telephone, shade, thinking)."""
    return place(draw, (-0.06, 0.13, 0.14), (0.08, 0.11, 0.06), (0.4, -0.8, 0.35), 0.4)


def crossed(draw: Draw) -> Array:
    """Fold the arm across the chest."""
    return place(draw, (-0.25, -0.20, 0.20), (0.07, 0.07, 0.05), (0.5, -0.85, 0.2), 0.2)


def behind_back(draw: Draw) -> Array:
    """Hold the hand behind the back."""
    return place(draw, (-0.12, -0.38, -0.17), (0.07, 0.06, 0.03), (0.7, 0.0, -0.7), 0.2)


def before_belly(draw: Draw) -> Array:
    """Hold the hand before belly or lap, where the other can clasp it."""
    return place(draw, (-0.13, -0.36, 0.24), (0.07, 0.10, 0.08), (0.6, -0.6, -0.4), 0.3)


def aside_straight(draw: Draw) -> Array:
    """Stretch the arm to the side at any height."""
    return _angles(draw, (5, 18), (95, 32), (-15, 30), (12, 12))


def forward_straight(draw: Draw) -> Array:
    """Stretch the arm forward, pointing or reaching."""
    out = _angles(draw, (88, 25), (10, 22), (35, 30), (14, 13))
    return out


def overhead(draw: Draw) -> Array:
    """Raise the arm, straight or bent, above the head."""
    x, y, z = draw.normal(0.05, 0.14), draw.uniform(0.30, ARM_M), draw.normal(0.06, 0.12)
    out = arm_to_target(np.stack([x, y, z], axis=-1), draw.vector((0.7, 0.1, 0.5), (0.4, 0.4, 0.5)))
    out[..., 6] = draw.normal(0, 30)
    return out


def goal_post(draw: Draw) -> Array:
    """Hold the upper arm aside with the forearm up, forward or down (signals, surrender)."""
    return _angles(draw, (10, 15), (85, 15), (-40, 45), (88, 18))


def point_anywhere(draw: Draw) -> Array:
    """Point in any direction that a straight arm can."""
    direction = draw.vector((0.35, -0.05, 0.35), (1.0, 1.0, 0.9))
    size = np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 0.1)
    reach = draw.uniform(0.88, 1.0)[..., None] * ARM_M
    return _finish(draw, arm_to_target(direction / size * reach, draw.vector((0.5, -0.7, -0.4), (0.4,) * 3)))


def reach(draw: Draw) -> Array:
    """Move the wrist anywhere in the arm's workspace, the elbow mostly down and out."""
    direction = draw.vector((0.15, -0.1, 0.35), (1.0, 1.0, 0.95))
    size = np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 0.1)
    far = (0.22 + 0.78 * draw.uniform(0, 1) ** 0.6)[..., None] * ARM_M
    return _finish(draw, arm_to_target(direction / size * far, draw.vector((0.55, -0.6, -0.3), (0.6,) * 3)))


def _finish(draw: Draw, out: Array) -> Array:
    out[..., 6], out[..., 7], out[..., 8] = draw.normal(10, 35), draw.normal(8, 18), draw.normal(0, 8)
    return out


EVERYDAY: tuple[tuple[Sampler, float], ...] = (
    (hang, 5.0),
    (hang_away, 2.5),
    (ready, 3.0),
    (on_hip, 1.2),
    (behind_head, 0.6),
    (at_head, 1.0),
    (crossed, 0.6),
    (behind_back, 0.6),
    (before_belly, 1.6),
    (aside_straight, 1.6),
    (forward_straight, 1.6),
    (overhead, 1.4),
    (goal_post, 0.8),
    (point_anywhere, 1.0),
    (reach, 3.0),
)
"""Postures of a free arm, with their weights."""


def free_arm(draw: Draw) -> Array:
    """Sample any posture of one arm, (..., 9)."""
    return draw.mix([s for s, _ in EVERYDAY], [w for _, w in EVERYDAY], 9)


def low_arm(draw: Draw) -> Array:
    """Sample a posture below the shoulder, (..., 9)."""
    return draw.mix([hang, hang_away, ready, before_belly, on_hip], [4, 3, 3, 1, 1], 9)


def both(sampler: Sampler, alike: float = 0.5) -> Sampler:
    """Make a sampler of two arms, (..., 18), which are mirrored with some probability."""

    def sample(draw: Draw) -> Array:
        left, right = sampler(draw), sampler(draw)
        jitter = draw.rng.normal(size=left.shape) * 5.0
        same = draw.chance(alike)[..., None]
        return np.concatenate([left, np.where(same, left + jitter, right)], axis=-1)

    return sample


def together(draw: Draw) -> Array:
    """Move both hands to one place before, above or beside the body (ball, bat, pole, clap)."""
    centre = draw.vector((0.0, -0.12, 0.36), (0.26, 0.44, 0.16))
    gap = draw.vector((0.09, 0.0, 0.0), (0.08, 0.09, 0.06))
    poles = [draw.vector((0.7, -0.6, -0.1), (0.25, 0.35, 0.2)) for _ in range(2)]
    left = arm_to_target(centre + gap - _HALF_SHOULDERS, poles[0])
    right = arm_to_target(centre * _FLIP + gap - _HALF_SHOULDERS, poles[1])
    return np.concatenate([_finish(draw, left), _finish(draw, right)], axis=-1)


_HALF_SHOULDERS = np.array([0.175, 0.0, 0.0])
"""Vector from the middle to the left shoulder (m): `rest_nodes` at 1.75 m."""
_FLIP = np.array([-1.0, 1.0, 1.0])
"""Factor that mirrors a position left to right."""


def folded(draw: Draw) -> Array:
    """Cross both arms before the chest, one above the other."""
    left, right = crossed(draw), crossed(draw)
    return np.concatenate([left, right], axis=-1)


def free_arms(draw: Draw) -> Array:
    """Sample arm angles, (..., 18): independent, mirrored or coupled."""
    options = [both(free_arm, 0.45), both(reach, 0.3), together, folded, both(low_arm, 0.5)]
    return draw.mix(options, [5.0, 1.6, 2.6, 0.5, 2.5], 18)
