"""Postures on chairs, stools, sofas and on the floor, sitting.

The pelvis's height and the feet's places make the legs (`lower_body`); trunk and arms are drawn
around them. Seats are 0.32 (a low sofa) to 0.75 m (a bar stool) high, a chair's 0.43 to 0.48 (H. Dreyfuss
Associates, *The Measure of Man and Woman*, 1993); the pelvis of the dressed body lies about
0.14 m above the seat.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import ARM, LEG
from depth_pose.motion.procedural import arms as arms
from depth_pose.motion.procedural import legs as legs
from depth_pose.motion.procedural.draw import Draw, assemble, swap_sides
from depth_pose.motion.procedural.postures.parts import (
    Kind,
    Sampler,
    free_head,
    hands_at,
    level_gaze,
    set_angles,
)

Array = NDArray[np.float64]

HIP_ABOVE_SEAT_M = 0.14
"""Height of the hips above the seat, metres."""


def _lower(draw: Draw, low: tuple[float, float], trunk: tuple[Array, Array], far: Array) -> Array:
    """Sit on a seat of a height within `low` (m), feet within `far` (m) in front of the pelvis."""
    flexion, lean = trunk
    height = draw.uniform(*low) + HIP_ABOVE_SEAT_M
    # Feet that the legs cannot reach come nearer; near feet go under the seat on their toes.
    far = np.minimum(far, np.sqrt(np.maximum(0.84**2 - (height - 0.08) ** 2, 0.04)))
    zero = np.zeros(draw.shape)
    spread = draw.pick(0.06, 0.32, 1.3)
    left = np.stack([spread, zero, far + draw.normal(0, 0.05)], axis=-1)
    right = np.stack([-spread + draw.normal(0, 0.04), zero, far + draw.normal(0, 0.05)], axis=-1)
    pitch = np.maximum(0.30 - far, 0)[:, None] * draw.uniform(0, 160)[:, None] * np.ones(2)
    pelvis = np.stack([flexion, draw.normal(0, 3), draw.normal(0, 4)], axis=-1)
    return legs.lower_body(pelvis, height, left, right, draw.vector((10, 10), (16, 16)), pitch, lean)


def _seated(trunk: str, far: tuple[float, float], seat: tuple[float, float] = (0.38, 0.54)) -> Sampler:
    """Make a sampler of legs and trunk; the arms are left hanging."""

    def sample(draw: Draw) -> Array:
        flexion, lean = _TRUNKS[trunk](draw)
        lower = _lower(draw, seat, (flexion, lean), draw.uniform(*far))
        out = assemble(draw.uniform(0, 1), lower[:, :15], None, lower[:, 15:])
        out[:, 4] += draw.normal(0, 4)
        out[:, 8] += draw.normal(0, 8)
        return out + free_head(draw)

    return sample


_TRUNKS = {
    # Flexion of the pelvis and of the trunk against it, degrees: a seated pelvis rolls back by
    # some 10 to 40 and the lumbar spine flattens or bends forward.
    "upright": lambda d: (d.normal(-8, 6), d.normal(12, 7)),
    "slouched": lambda d: (d.uniform(-42, -16), d.uniform(12, 48)),
    "forward": lambda d: (d.uniform(2, 32), d.uniform(14, 45)),
    "back": lambda d: (d.uniform(-32, -14), d.uniform(-6, 14)),
}


def _with_arms(base: Sampler, pair: Sampler) -> Sampler:
    def sample(draw: Draw) -> Array:
        out = base(draw)
        out[:, ARM[0].start : ARM[1].stop] = pair(draw)
        return out

    return sample


def _hands(base: Sampler, centre: tuple[float, float, float], spread: tuple[float, float, float]) -> Sampler:
    """Move both hands to a place relative to the pelvis (and its mirror image)."""

    def sample(draw: Draw) -> Array:
        out = base(draw)
        goal, other = draw.vector(centre, spread), draw.vector(centre, spread)
        other = np.where(draw.chance(0.6)[:, None], goal + draw.vector((0, 0, 0), (0.03,) * 3), other)
        out = hands_at(out, goal, other * [-1, 1, 1], draw.vector((0.6, -0.6, -0.5), (0.25,) * 3))
        return set_angles(out, {"both_forearm_pronation": draw.normal(60, 20)})

    return sample


def _typing(draw: Draw) -> Array:
    """Type or work at a desk: wrists a little above the elbows, a forearm's length ahead."""
    base = draw.mix(
        [_seated("upright", (0.25, 0.55)), _seated("forward", (0.2, 0.5)), _seated("slouched", (0.3, 0.65))],
        [3, 2, 1.5],
        47,
    )
    out = _hands(lambda _: base, (0.13, 0.20, 0.38), (0.10, 0.07, 0.12))(draw)
    return np.where(draw.chance(0.7)[:, None], level_gaze(out, draw), out)


def _crossed_legs(draw: Draw) -> Array:
    """Lay the left leg over the right: knee over knee, or the ankle on the knee."""
    base = draw.mix([_seated("upright", (0.3, 0.5)), _seated("back", (0.35, 0.6))], [1, 1], 47)
    lean = base[:, 0]
    over_knee = draw.chance(0.55)[:, None]
    zero = np.zeros(draw.shape)
    knees = np.stack(
        [
            lean + draw.normal(103, 5), draw.normal(-16, 4), draw.normal(4, 5),
            draw.uniform(62, 98), draw.normal(-12, 10), zero, draw.normal(5, 6),
        ],
        axis=-1,
    )  # fmt: skip
    ankle = np.stack(
        [
            lean + draw.normal(82, 6), draw.uniform(32, 52), draw.normal(-38, 7),
            draw.normal(105, 9), draw.normal(0, 10), draw.normal(10, 8), zero,
        ],
        axis=-1,
    )  # fmt: skip
    out = base.copy()
    out[:, LEG[0]] = np.where(over_knee, knees, ankle)
    pair = draw.mix([arms.both(arms.before_belly, 0.7), arms.folded, arms.free_arms], [3, 1, 2], 18)
    out[:, ARM[0].start : ARM[1].stop] = pair
    return swap_sides(out, draw.chance(0.5))


def _elbows_on_knees(draw: Draw) -> Array:
    base = _seated("forward", (0.25, 0.45))(draw)
    base[:, 0] += draw.uniform(5, 22)
    return _hands(lambda _: base, (0.05, 0.12, 0.50), (0.09, 0.10, 0.10))(draw)


def _anything(draw: Draw) -> Array:
    options = [_seated("upright", (0.2, 0.6)), _seated("slouched", (0.3, 0.8)), _seated("back", (0.3, 0.7))]
    base = draw.mix(options, [3, 2, 2], 47)
    base[:, ARM[0].start : ARM[1].stop] = arms.free_arms(draw)
    return base


def _reading(draw: Draw) -> Array:
    base = draw.mix([_seated("slouched", (0.3, 0.75)), _seated("back", (0.3, 0.7))], [2, 1], 47)
    base[:, 9] += draw.uniform(5, 25)
    base[:, 12] += draw.uniform(5, 20)
    return _hands(lambda _: base, (0.09, 0.30, 0.30), (0.07, 0.10, 0.07))(draw)


def _floor_legs(draw: Draw) -> Array:
    """Sit on the floor: legs crossed, stretched out, or knees drawn up."""
    pelvis, lean = draw.uniform(-32, -12), draw.uniform(14, 46)
    kind = draw.uniform(0, 1)[:, None]
    # Crossed legs need a pelvis that rolls back and hips turned out as far as they go.
    pelvis = np.where(kind[:, 0] < 0.4, np.minimum(pelvis, -22.0), pelvis)
    out = np.zeros((*draw.shape, 47))
    out[:, 0] = pelvis
    out[:, 3], out[:, 6] = 0.55 * lean, 0.45 * lean
    zero = np.zeros(draw.shape)
    for side in (0, 1):
        tailor = np.stack(
            [
                draw.normal(96, 4), draw.normal(38, 4), draw.normal(-48, 2),
                draw.normal(135, 6), draw.normal(-20, 10), draw.normal(15, 8), zero,
            ],
            axis=-1,
        )  # fmt: skip
        straight = np.stack(
            [
                pelvis + draw.normal(90, 2), draw.uniform(0, 22), draw.normal(-8, 8),
                draw.pick(1, 8, 2), draw.normal(-15, 10), zero, draw.normal(8, 8),
            ],
            axis=-1,
        )  # fmt: skip
        # A knee raised by a from level and bent by 2 a brings the foot back to the floor.
        thigh = draw.uniform(122, 142)
        drawn_up = np.stack(
            [
                pelvis + thigh, draw.uniform(2, 14), draw.normal(-5, 6),
                2 * (thigh - 90) + draw.normal(0, 4), thigh - 180.0, zero, draw.normal(8, 6),
            ],
            axis=-1,
        )  # fmt: skip
        out[:, LEG[side]] = np.where(kind < 0.4, tailor, np.where(kind < 0.65, straight, drawn_up))
    return out + free_head(draw)


def _on_floor(draw: Draw) -> Array:
    base = _floor_legs(draw)
    on_knees = _hands(lambda _: base, (0.15, 0.20, 0.38), (0.10, 0.12, 0.10))(draw)
    propped = hands_at(
        base,
        draw.vector((0.28, -0.03, -0.25), (0.08, 0.02, 0.08)),
        draw.vector((-0.28, -0.03, -0.25), (0.08, 0.02, 0.08)),
        draw.vector((0.5, 0.0, -0.8), (0.2,) * 3),
    )
    propped = set_angles(propped, {"both_wrist_flexion": draw.normal(-55, 12)})
    return np.where(draw.chance(0.75)[:, None], on_knees, propped)


_LAP = (0.11, 0.09, 0.28)
"""Mean position of the left hand in the lap, relative to the pelvis (m)."""

SIT = (
    Kind("type", 3.0, _typing, raised=True),
    Kind("free", 1.6, _hands(_seated("upright", (0.22, 0.6)), _LAP, (0.09, 0.05, 0.10)), raised=True),
    Kind("free", 1.3, _hands(_seated("slouched", (0.3, 0.85)), _LAP, (0.10, 0.06, 0.08)), raised=True),
    Kind(
        "free", 0.8, _hands(_seated("back", (0.3, 0.8), (0.32, 0.46)), _LAP, (0.14, 0.08, 0.10)), raised=True
    ),
    Kind("free", 0.9, _elbows_on_knees, raised=True),
    Kind("free", 1.3, _crossed_legs, raised=True),
    Kind("free", 0.6, _with_arms(_seated("upright", (0.2, 0.7)), arms.folded), raised=True),
    Kind("free", 1.4, _anything, raised=True),
    Kind("free", 0.5, _with_arms(_seated("upright", (0.1, 0.5), (0.56, 0.75)), arms.free_arms), raised=True),
    Kind("read", 1.2, _reading, raised=True),
    Kind("free", 1.1, _on_floor),
)
"""Ways to sit, lengths in metres, with their weights."""
