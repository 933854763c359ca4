"""Postures near the floor: lying, kneeling, squatting, crawling.

Angles follow from the geometry of segments that rest on the floor: with the thigh at an angle a
forward of hanging, a shank lies flat behind when the knee bends by 90 + a. People lie on their
back, side and front in about the shares in which they sleep (H. De Koninck et al., *Sleep
positions and position shifts in five age groups*, Sleep 15, 1992: mostly on the side), with the
back more frequent because people who watch, rest or have fallen lie so.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import ARM, LEG, rotations_from_angles
from depth_pose.core.rotations import rotation_x, rotation_z
from depth_pose.motion.contact import pelvis_height
from depth_pose.motion.procedural import arms as arms
from depth_pose.motion.procedural import legs as legs
from depth_pose.motion.procedural.draw import Draw, assemble, swap_sides
from depth_pose.motion.procedural.postures.parts import (
    Kind,
    bow,
    free_head,
    hands_at,
    level_gaze,
    set_angles,
    support_hands,
)
from depth_pose.motion.procedural.postures.upright import of_family

Array = NDArray[np.float64]


def _columns(*values: Array | float) -> Array:
    return np.stack(np.broadcast_arrays(*values), axis=-1)


def _lying_turn(low: float, high: float) -> Callable[[Draw], Array]:
    """Rotation of a lying body: 0 on the back, 90 on a side, 180 on the front, degrees."""

    def turn(draw: Draw) -> Array:
        roll, sign = np.radians(draw.uniform(low, high)), np.where(draw.chance(0.5), 1.0, -1.0)
        flat = rotation_x(np.radians(-90.0 + draw.normal(0, 1.5)))
        return rotation_z(sign * roll) @ flat

    return turn


def _on_back(draw: Draw) -> Array:
    """Lie on the back: arms anywhere in the plane or on the belly, legs straight or drawn up."""
    out = bow(draw, draw.normal(4, 5), draw.normal(0, 6)) + 0.3 * free_head(draw)
    out[:, 9] += draw.pick(0, 25, 2)
    for side in (0, 1):
        beside = _columns(
            0.0, 0.0, draw.normal(-8, 3), draw.pick(12, 170, 1.8), draw.normal(-25, 20),
            draw.pick(5, 90, 1.6), draw.normal(20, 35), draw.normal(5, 10), 0.0,
        )  # fmt: skip
        on_belly = arms.place(draw, (-0.12, -0.30, 0.17), (0.08, 0.14, 0.04), (0.9, -0.3, -0.3), 0.2)
        behind = arms.behind_head(draw)
        kind = draw.uniform(0, 1)[:, None]
        arm = np.where(kind < 0.55, beside, np.where(kind < 0.88, on_belly, behind))
        out[:, ARM[side]] = arm
        level = _columns(
            draw.normal(-2, 2), draw.pick(3, 32, 1.5), draw.normal(-14, 12),
            draw.pick(0, 8, 2), draw.normal(-28, 10), draw.normal(0, 5), draw.normal(8, 8),
        )  # fmt: skip
        rise = draw.uniform(18, 62)
        drawn_up = _columns(
            rise, draw.normal(6, 8), draw.normal(0, 8), 2 * rise + draw.normal(2, 3), rise - 70.0, 0.0, 5.0
        )
        out[:, LEG[side]] = np.where(draw.chance(0.25)[:, None], drawn_up, level)
    both = draw.chance(0.5)[:, None]
    out[:, LEG[1]] = np.where(both, out[:, LEG[0]] + draw.normal(0, 2)[:, None], out[:, LEG[1]])
    return out


def _on_side(draw: Draw) -> Array:
    """Lie on the side: hips and knees bent, arms before the body or under the head."""
    curl = draw.uniform(0, 1)
    out = bow(draw, 8 + 38 * curl * draw.uniform(0, 1), draw.normal(0, 4), draw.normal(0, 8))
    out += 0.3 * free_head(draw)
    hip = 8 + 80 * curl * draw.uniform(0.6, 1.1)
    knee = 15 + 95 * curl * draw.uniform(0.5, 1.1)
    for side in (0, 1):
        out[:, LEG[side]] = _columns(
            hip + draw.normal(0, 12), draw.normal(-3, 4), draw.normal(0, 6),
            np.clip(knee + draw.normal(0, 14), 3, 140), draw.normal(-20, 10), 0.0, draw.normal(5, 5),
        )  # fmt: skip
        before = arms.place(draw, (-0.08, -0.12, 0.32), (0.10, 0.20, 0.10), (0.4, -0.8, 0.2), 0.25)
        under_head = arms.place(draw, (-0.05, 0.18, 0.14), (0.05, 0.07, 0.08), (0.3, -0.5, 0.8), 0.25)
        along = arms.hang(draw)
        kind = draw.uniform(0, 1)[:, None]
        out[:, ARM[side]] = np.where(kind < 0.55, before, np.where(kind < 0.8, under_head, along))
    return out


def _on_front(draw: Draw) -> Array:
    """Lie on the front: the face to a side, arms up beside the head or along the body."""
    out = bow(draw, draw.normal(-4, 4), draw.normal(0, 6))
    away = np.where(draw.chance(0.5), 1.0, -1.0) * draw.uniform(35, 70)
    out[:, 9:15] = 0.0
    out[:, 11], out[:, 14] = 0.45 * away, 0.55 * away
    for side in (0, 1):
        up = _columns(
            draw.normal(8, 6), 0.0, draw.normal(6, 6), draw.uniform(85, 160), draw.normal(-70, 15),
            draw.uniform(20, 100), draw.normal(60, 25), 0.0, 0.0,
        )  # fmt: skip
        along = arms.hang(draw)
        out[:, ARM[side]] = np.where(draw.chance(0.6)[:, None], up, along)
        out[:, LEG[side]] = _columns(
            draw.normal(0, 2), draw.pick(3, 30, 1.5), draw.normal(0, 12),
            draw.pick(0, 25, 3), draw.normal(-48, 6), 0.0, draw.normal(0, 8),
        )  # fmt: skip
    crawl = draw.chance(0.25)[:, None]
    bent = _columns(
        draw.uniform(15, 35), draw.uniform(30, 50), draw.normal(-30, 6), draw.uniform(40, 90), -40.0, 0.0, 0.0
    )
    out[:, LEG[0]] = np.where(crawl, bent, out[:, LEG[0]])
    return out


def _reclined(draw: Draw) -> Array:
    """Lie half raised against pillows or an arm rest, or propped on the elbows."""
    out = _on_back(draw)
    rise = draw.uniform(15, 55)
    out[:, 3] += 0.6 * rise
    out[:, 6] += 0.4 * rise
    return out


_INSTEP_DEG, _TUCKED_DEG = 8.0, 12.0
"""Slope of the shank from the knee up to the ankle (degrees), with the instep or the toes on the floor: the
ankle is 6 or 9 cm higher than the front of the knee, over a shank of 0.43 m."""


def _shank_back(thigh: Array, tucked: Array | NDArray[np.bool_] | bool = False) -> Array:
    """Compute the knee flexion that lays the shank on the floor, from the hip flexion (degrees)."""
    return np.clip(90.0 + thigh + np.where(tucked, _TUCKED_DEG, _INSTEP_DEG), 60.0, 150.0)


def _kneel_legs(draw: Draw, pelvis: Array, thigh: Array) -> Array:
    """Both knees on the floor, (N, 47), arms hanging."""
    out = bow(draw, draw.normal(6, 9), draw.normal(0, 3), draw.normal(0, 8)) + 0.5 * free_head(draw)
    out[:, 0] = pelvis
    apart = draw.pick(2, 26, 1.5)
    tucked = draw.chance(0.3)
    for side in (0, 1):
        turn = thigh + draw.normal(0, 2)
        out[:, LEG[side]] = _columns(
            pelvis + turn, apart + draw.normal(0, 2), draw.normal(0, 5), _shank_back(turn, tucked),
            np.where(tucked, 30.0, -50.0) + draw.normal(0, 4), 0.0, draw.normal(4, 5),
        )  # fmt: skip
    return out


def _kneel_up(draw: Draw) -> Array:
    pelvis = draw.normal(6, 8)
    out = _kneel_legs(draw, pelvis, draw.normal(2, 7))
    out[:, ARM[0].start : ARM[1].stop] = arms.free_arms(draw)
    return out


def _on_heels(draw: Draw) -> Array:
    """Sit back on the heels."""
    pelvis = draw.normal(2, 8)
    out = _kneel_legs(draw, pelvis, draw.uniform(42, 52))
    lap = draw.vector((0.10, 0.12, 0.25), (0.08, 0.10, 0.08))
    held = hands_at(out, lap, lap * [-1, 1, 1], draw.vector((0.6, -0.5, -0.5), (0.2,) * 3))
    free = out.copy()
    free[:, ARM[0].start : ARM[1].stop] = arms.free_arms(draw)
    return np.where(draw.chance(0.6)[:, None], held, free)


def _one_knee(draw: Draw) -> Array:
    lower = legs.kneel(draw)
    pair = draw.mix(
        [arms.free_arms, arms.both(arms.before_belly, 0.6), arms.both(arms.ready, 0.5)], [3, 1, 1], 18
    )
    out = assemble(draw.uniform(0, 1), lower[:, :15], pair, lower[:, 15:]) + free_head(draw)
    return swap_sides(out, draw.chance(0.5))


def _work_low(draw: Draw) -> Array:
    """Kneel bent forward with the hands at work near the floor."""
    pelvis = draw.uniform(20, 55)
    out = _kneel_legs(draw, pelvis, draw.uniform(0, 40))
    out[:, 3] += draw.uniform(5, 22)
    out[:, 6] += draw.uniform(5, 18)
    floor = pelvis_height(rotations_from_angles(out))
    goal = draw.vector((0.12, 0.0, 0.55), (0.12, 0.0, 0.15))
    goal[:, 1] = draw.uniform(0.03, 0.35) - floor
    return hands_at(out, goal, goal * [-1, 1, 1], draw.vector((0.6, -0.5, -0.4), (0.25,) * 3))


def _crawl(draw: Draw) -> Array:
    """Crawl on hands and knees."""
    pelvis = draw.uniform(64, 92)
    out = bow(draw, draw.normal(6, 8), draw.normal(0, 5), draw.normal(0, 6))
    out[:, 0] = pelvis
    stride = draw.normal(0, 14)
    for side, sign in ((0, 1.0), (1, -1.0)):
        thigh = draw.normal(0, 5) + sign * stride
        out[:, LEG[side]] = _columns(
            pelvis + thigh, draw.pick(2, 14, 1.5), 0.0, _shank_back(thigh), draw.normal(-48, 5), 0.0, 0.0
        )
    floor = pelvis_height(rotations_from_angles(out))
    wrist = draw.uniform(0.07, 0.10) - floor
    hands = []
    for sign in (1.0, -1.0):
        far = 0.48 + draw.normal(0, 0.05) - sign * 0.004 * stride
        hands.append(np.stack([sign * draw.uniform(0.10, 0.24), wrist, far], axis=-1))
    out = hands_at(out, hands[0], hands[1], draw.vector((0.5, -0.5, -0.6), (0.25,) * 3))
    out = set_angles(out, support_hands(draw))
    return np.where(draw.chance(0.6)[:, None], level_gaze(out, draw), out)


def _deep_squat(draw: Draw) -> Array:
    """Squat low on flat feet or toes, the arms before or around the knees."""
    zero = np.zeros(draw.shape)
    height, wide = draw.uniform(0.24, 0.42), draw.uniform(0.10, 0.26)
    forward = draw.uniform(0.10, 0.24)
    toes = draw.chance(0.45) * draw.uniform(20, 50)
    left, right = _columns(wide, zero, forward), _columns(-wide, zero, forward + draw.normal(0, 0.04))
    lean = draw.uniform(18, 50)
    lower = legs.lower_body(
        _columns(0.45 * lean, draw.normal(0, 3), draw.normal(0, 4)), height, left, right,
        _columns(draw.uniform(5, 30), draw.uniform(5, 30)), _columns(toes, toes), 0.7 * lean,
    )  # fmt: skip
    out = assemble(draw.uniform(0, 1), lower[:, :15], arms.free_arms(draw), lower[:, 15:]) + free_head(draw)
    goal = draw.vector((0.08, 0.15, 0.50), (0.12, 0.22, 0.10))
    held = hands_at(out, goal, goal * [-1, 1, 1], draw.vector((0.8, -0.4, -0.2), (0.25,) * 3))
    return np.where(draw.chance(0.75)[:, None], held, out)


LIE = (
    Kind("rest", 2.2, _on_back, _lying_turn(-8, 8)),
    Kind("rest", 1.8, _on_side, _lying_turn(65, 105)),
    Kind("rest", 1.0, _on_front, _lying_turn(172, 188)),
    Kind("rest", 0.8, _reclined, _lying_turn(-6, 6)),
)
"""Ways to lie, with their weights."""
KNEEL = (
    Kind("free", 1.0, _kneel_up),
    Kind("free", 1.0, _on_heels),
    Kind("free", 1.2, _one_knee),
    Kind("free", 1.0, _work_low),
)
"""Ways to kneel, with their weights."""
SQUAT = (Kind("free", 1.0, of_family("squats")), Kind("free", 1.2, _deep_squat))
"""Ways to squat, with their weights."""
CRAWL = (Kind("support", 1.0, _crawl),)
"""The way to crawl."""
