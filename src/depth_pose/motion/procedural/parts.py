"""Shared parts of the motion families: the motion itself, free head and trunk, standing legs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.motion.procedural import legs as legs
from depth_pose.motion.procedural.draw import Draw, assemble, swap_sides, sway

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Postures in time before limits, contact and floor.

    Attributes
    ----------
    angles : (T, 47) float64
        Degrees; the pelvis twist is the heading.
    lift : (T,) float64
        Height of the lowest point above the floor, metres.
    """

    angles: Array
    lift: Array


Family = Callable[[Array, Draw], Motion]


def still(angles: Array) -> Motion:
    """Return a motion that stays on the floor."""
    return Motion(angles, np.zeros(angles.shape[:-1]))


def looks_around(t: Array, draw: Draw, twist: float = 22.0, lean: float = 7.0) -> Array:
    """Draw small independent motion of head and trunk, (T, 15)."""
    out = np.zeros((*t.shape, 15))
    look, nod, tilt = draw.normal(0, twist), draw.normal(-2, 9), draw.normal(0, 5)
    turn, side, bow = draw.normal(0, 0.55 * twist), draw.normal(0, lean), draw.normal(0, 0.8 * lean)
    for part, share in ((3, 0.4), (4, 0.6)):
        out[..., 3 * part] = share * (nod + sway(draw, t, 5))
        out[..., 3 * part + 1] = share * tilt
        out[..., 3 * part + 2] = share * (look + sway(draw, t, 12))
    for part, share in ((1, 0.45), (2, 0.55)):
        out[..., 3 * part] = share * (bow + sway(draw, t, 3))
        out[..., 3 * part + 1] = share * (side + sway(draw, t, 3))
        out[..., 3 * part + 2] = share * (turn + sway(draw, t, 6))
    return out


def join(t: Array, draw: Draw, lower: Array, upper: Array, looks: Array | None = None) -> Array:
    """Combine lower body, two arms, trunk and head, (T, 47)."""
    trunk = lower[..., :15] + (looks_around(t, draw) if looks is None else looks)
    return assemble(t, trunk, upper, lower[..., 15:])


def standing(draw: Draw) -> Array:
    """Draw an everyday standing posture, (..., 29)."""
    return draw.mix([legs.stand, legs.stand_wide, legs.crouch], [6, 2, 0.8], legs.LOWER)


def either_side(draw: Draw, angles: Array) -> Array:
    """Mirror the motion, or each posture of a set, with even chances."""
    return swap_sides(angles, np.broadcast_to(draw.chance(0.5), angles.shape[:-1]))
