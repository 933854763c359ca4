"""Postures on two feet: standing about, walking, bending, reaching, leaning on things.

Free motion comes from the families of the embedded motion source
(`depth_pose.motion.procedural.families`) at random moments; here are the everyday postures
that it lacks. Places are metres on the 1.75 m body. Heights of tables, counters and
shelves are those of H. Dreyfuss Associates, *The Measure of Man and Woman*, 1993 (desk 0.71 to
0.76, counter 0.91, bar 1.07).

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import ARM, rotations_from_angles
from depth_pose.motion.contact import pelvis_height
from depth_pose.motion.procedural import arms as arms
from depth_pose.motion.procedural import legs as legs
from depth_pose.motion.procedural.draw import Draw, assemble
from depth_pose.motion.procedural.families import FAMILIES
from depth_pose.motion.procedural.parts import standing
from depth_pose.motion.procedural.postures.parts import (
    Kind,
    Sampler,
    free_head,
    hands_at,
    level_gaze,
    set_angles,
    support_hands,
)
from depth_pose.motion.reach import arm_to_target

Array = NDArray[np.float64]

_LONGEST_S = 20.0
"""Maximum length (s) of a motion that moments are taken from."""


def of_family(name: str) -> Sampler:
    """Make a sampler of random moments of a family of motions, without its heading."""

    def sample(draw: Draw) -> Array:
        out = FAMILIES[name].motion(draw.uniform(0.0, _LONGEST_S), draw).angles.copy()
        out[:, 2] = draw.normal(0, 6)
        return out

    return sample


def _on_legs(draw: Draw, lower: Array, upper: Array) -> Array:
    return assemble(draw.uniform(0, 1), lower[:, :15], upper, lower[:, 15:]) + free_head(draw)


def _stand(arm_pair: Sampler) -> Sampler:
    return lambda draw: _on_legs(draw, standing(draw), arm_pair(draw))


def _in_pocket(draw: Draw) -> Array:
    """Keep the hand in a trouser pocket, thumb at the hip's crease."""
    return arms.place(draw, (0.03, -0.47, 0.08), (0.04, 0.04, 0.05), (0.8, -0.1, -0.6), 0.25)


def _pockets(draw: Draw) -> Array:
    return arms.both(lambda d: d.mix([_in_pocket, arms.hang], [4, 1], 9), 0.7)(draw)


def _screen(draw: Draw) -> Array:
    """Hold a telephone or book before the chest."""
    return arms.place(draw, (-0.12, -0.17, 0.30), (0.07, 0.10, 0.07), (0.5, -0.85, -0.1), 0.25)


def _reading(draw: Draw) -> Array:
    one = draw.mix([arms.hang, _in_pocket, _screen, arms.crossed], [2, 2, 3, 1], 9)
    return np.concatenate([_screen(draw), one], axis=-1)


def _reads(draw: Draw) -> Array:
    out = _on_legs(draw, standing(draw), _reading(draw))
    down = draw.uniform(8, 28)
    out[:, 9] += down
    out[:, 12] += 0.8 * down
    return out


def _at_ear(draw: Draw) -> Array:
    """Hold a telephone at the ear."""
    return arms.place(draw, (-0.07, 0.14, 0.06), (0.04, 0.05, 0.04), (0.6, -0.7, 0.3), 0.3)


def _telephones(draw: Draw) -> Array:
    other = draw.mix([arms.hang, _in_pocket, arms.on_hip, arms.ready, arms.crossed], [3, 2, 1, 1, 1], 9)
    return np.concatenate([_at_ear(draw), other], axis=-1)


def _both_before(draw: Draw, height: tuple[float, float], wide: tuple[float, float]) -> Array:
    """Hold a thing with both hands before the body, relative to the shoulders."""
    out = np.zeros((*draw.shape, 18))
    half, up, out_there = draw.uniform(*wide), draw.uniform(*height), draw.uniform(0.20, 0.40)
    poles = draw.vector((0.6, -0.7, -0.3), (0.2, 0.2, 0.2))
    for side in (0, 1):
        target = np.stack([half - 0.175, up + draw.normal(0, 0.015), out_there], axis=-1)
        out[:, 9 * side : 9 * side + 9] = arm_to_target(target, poles)
        out[:, 9 * side + 6] = draw.normal(0, 15)
    return out


def _carry(draw: Draw) -> Array:
    return _both_before(draw, (-0.48, -0.10), (0.06, 0.28))


def _carry_walking(draw: Draw) -> Array:
    out = of_family("walk")(draw)
    out[:, ARM[0].start : ARM[1].stop] = _carry(draw)
    return out


def _talk_walking(draw: Draw) -> Array:
    out = of_family("walk")(draw)
    pair = draw.mix([_reading, _telephones, _pockets], [2, 2, 1], 18)
    out[:, ARM[0].start : ARM[1].stop] = pair
    return out


def _towards(draw: Draw, centre: tuple[float, float, float], spread: tuple[float, float, float]) -> Array:
    """Reach out to a place with one hand or both, the trunk following."""
    single = draw.chance(0.6)
    out = _on_legs(draw, standing(draw), arms.both(arms.low_arm, 0.4)(draw))
    forward = draw.pick(0, 28, 1.5)
    out[:, 0] += 0.4 * forward
    out[:, 3] += 0.35 * forward
    out[:, 6] += 0.25 * forward
    turn = np.where(single, draw.normal(-14, 10), draw.normal(0, 5))
    out[:, 5] += 0.4 * turn
    out[:, 8] += 0.6 * turn
    goal = draw.vector(centre, spread)
    gap = draw.uniform(0.02, 0.25)[:, None] * np.array([1.0, 0.0, 0.0])
    reached = hands_at(out, goal + gap, goal - gap, draw.vector((0.6, -0.7, -0.2), (0.3,) * 3))
    right = slice(ARM[1].start, ARM[1].stop)
    reached[:, right] = np.where(single[:, None], out[:, right], reached[:, right])
    return reached


def _reach_forward(draw: Draw) -> Array:
    """Reach forward, as to a shelf, a door or a camera."""
    return _towards(draw, (0.08, 0.40, 0.62), (0.30, 0.28, 0.20))


def _reach_up(draw: Draw) -> Array:
    """Reach up, as to a cupboard or a lamp."""
    return _towards(draw, (0.10, 0.95, 0.25), (0.30, 0.18, 0.25))


def _reach_low(draw: Draw) -> Array:
    """Reach low to the front or side, as to a drawer."""
    return _towards(draw, (0.25, -0.20, 0.50), (0.35, 0.25, 0.25))


def _pick_up(draw: Draw) -> Array:
    """Bend down to the floor or a low place, the hands at work there or hanging."""
    out = _on_legs(draw, legs.bend(draw), arms.both(arms.hang, 0.6)(draw))
    floor = pelvis_height(rotations_from_angles(out))
    goal = draw.vector((0.10, 0.0, 0.45), (0.14, 0.0, 0.18))
    goal[:, 1] = draw.uniform(0.05, 0.60) - floor
    held = hands_at(out, goal, goal * [-1, 1, 1], draw.vector((0.7, -0.2, -0.6), (0.3,) * 3))
    single = draw.chance(0.35)[:, None]
    right = slice(ARM[1].start, ARM[1].stop)
    held[:, right] = np.where(single, out[:, right], held[:, right])
    return np.where(draw.chance(0.7)[:, None], held, out)


def _on_table(draw: Draw) -> Array:
    """Lean over a table on both hands or one."""
    angle = draw.uniform(12, 62)
    lower = legs.stand(draw)
    back = 0.10 * np.sin(np.radians(angle))[:, None] * np.array([0.0, 0.0, 1.0])
    flexion = draw.uniform(0.45, 0.75) * angle
    pelvis = np.stack([flexion, draw.normal(0, 3), draw.normal(0, 5)], axis=-1)
    width, stagger = draw.uniform(0.12, 0.42)[:, None], draw.normal(0, 0.08)[:, None]
    aside, ahead = np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, 0.5])
    feet = [s * (width * aside + stagger * ahead) + back for s in (1.0, -1.0)]
    lower = legs.lower_body(
        pelvis, legs.STANDING_M - draw.uniform(0.01, 0.06), feet[0], feet[1],
        np.stack([draw.uniform(-3, 22)] * 2, axis=-1), np.zeros((*draw.shape, 2)), angle - flexion,
    )  # fmt: skip
    out = _on_legs(draw, lower, arms.both(arms.low_arm, 0.4)(draw))
    floor = pelvis_height(rotations_from_angles(out))
    table = draw.uniform(0.68, 1.05)
    half, far = draw.uniform(0.10, 0.40), draw.uniform(0.22, 0.62)
    goal = np.stack([half, table + 0.05 - floor, far], axis=-1)
    leaned = hands_at(out, goal, goal * [-1, 1, 1], draw.vector((0.7, 0.2, -0.6), (0.3,) * 3))
    leaned = set_angles(leaned, support_hands(draw))
    single = draw.chance(0.3)[:, None]
    right = slice(ARM[1].start, ARM[1].stop)
    leaned[:, right] = np.where(single, out[:, right], leaned[:, right])
    return np.where(draw.chance(0.5)[:, None], leaned, level_gaze(leaned, draw))


def _against(draw: Draw) -> Array:
    """Lean back against a wall, a desk's edge or a car, feet before the body."""
    tilt = draw.uniform(-20, -6)
    zero = np.zeros(draw.shape)
    forward = -0.95 * np.sin(np.radians(tilt))
    width = draw.uniform(0.10, 0.35)
    left = np.stack([width / 2, zero, forward + draw.normal(0, 0.05)], axis=-1)
    right = np.stack([-width / 2, zero, forward + draw.normal(0, 0.05)], axis=-1)
    # One foot may be drawn up against the wall.
    up = draw.chance(0.2)
    left[:, 1] = np.where(up, draw.uniform(0.2, 0.45), 0.0)
    left[:, 2] = np.where(up, draw.uniform(-0.15, 0.05), left[:, 2])
    lower = legs.lower_body(
        np.stack([0.6 * tilt, draw.normal(0, 2), draw.normal(0, 4)], axis=-1),
        legs.STANDING_M * np.cos(np.radians(tilt)) - draw.uniform(0.01, 0.10), left, right,
        np.stack([draw.uniform(-3, 25)] * 2, axis=-1),
        np.stack([np.where(up, 35.0, 0.0), zero], axis=-1), draw.normal(0, 6) + 0.3 * tilt,
    )  # fmt: skip
    options = [
        arms.folded,
        _pockets,
        _reading,
        arms.both(arms.behind_back, 0.9),
        arms.both(arms.low_arm, 0.6),
    ]
    return _on_legs(draw, lower, draw.mix(options, [3, 2, 2, 2, 3], 18))


def _aside(draw: Draw) -> Array:
    """Lean sideways with a raised hand against a wall or door frame, or an elbow on a counter."""
    side = draw.uniform(4, 16)
    out = _on_legs(draw, legs.stand(draw), arms.both(arms.low_arm, 0.3)(draw))
    out[:, 1] += side
    out[:, 4] += 0.5 * side
    on_wall = draw.chance(0.6)[:, None]
    wall = draw.vector((0.50, 0.55, 0.10), (0.14, 0.22, 0.20))
    counter = draw.vector((0.38, 0.22, 0.28), (0.10, 0.12, 0.12))
    goal = np.where(on_wall, wall, counter)
    return hands_at(out, goal, None, draw.vector((0.5, -0.8, -0.1), (0.25,) * 3))


STAND = (
    Kind("free", 2.0, of_family("stand_casual")),
    Kind("free", 1.2, of_family("stand_gesture")),
    Kind("free", 1.4, of_family("crossed_arms")),
    Kind("free", 0.7, of_family("wave")),
    Kind("free", 0.6, of_family("signals")),
    Kind("free", 0.4, of_family("raise_arms")),
    Kind("free", 0.3, of_family("balance")),
    Kind("free", 0.3, of_family("turn_on_spot")),
    Kind("free", 0.9, of_family("play")),
    Kind("free", 1.6, _stand(_pockets)),
    Kind("free", 0.7, _stand(arms.both(arms.on_hip, 0.7))),
    Kind("free", 0.5, _stand(arms.both(arms.point_anywhere, 0.1))),
    Kind("free", 1.6, _stand(arms.both(arms.hang, 0.8))),
    Kind("read", 1.1, _reads),
    Kind("telephone", 0.7, _stand(_telephones)),
    Kind("carry", 1.3, _stand(_carry)),
    Kind("hold", 0.5, of_family("hold_things")),
)
"""Ways to stand, with their weights."""
WALK = (
    Kind("free", 4.0, of_family("walk")),
    Kind("free", 1.5, of_family("walk_gesture")),
    Kind("free", 1.0, of_family("run")),
    Kind("free", 0.5, of_family("side_step")),
    Kind("free", 0.3, of_family("lunges")),
    Kind("carry", 0.9, _carry_walking),
    Kind("read", 0.9, _talk_walking),
)
"""Ways to walk, with their weights."""
BEND = (
    Kind("free", 2.0, of_family("bends")),
    Kind("free", 2.5, _pick_up),
    Kind("free", 1.0, _reach_low),
)
"""Ways to bend, with their weights."""
REACH = (
    Kind("free", 1.5, of_family("reach_around")),
    Kind("free", 2.0, _reach_forward),
    Kind("free", 1.5, _reach_up),
    Kind("free", 0.7, _reach_low),
    Kind("free", 0.6, of_family("wash_window")),
)
"""Ways to reach, with their weights."""
LEAN = (
    Kind("support", 2.5, _on_table),
    Kind("free", 1.5, _against),
    Kind("free", 1.0, _aside),
)
"""Ways to lean, with their weights."""
