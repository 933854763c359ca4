"""Furniture of homes: 15 to 40 pieces in a room, many of them dark, some of them before people, and pets.

Rooms are those of `depth_pose.sim.rooms`; what `furnish_home` puts into them is what a finder of people meets
at home: prams, boxes on trolleys, coat stands with hats, laundry, televisions, dark sofas and carpets.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.sim.furniture import (
    AT_WALLS,
    STANDING,
    make_board,
    make_chair,
    make_plant,
    make_shelf,
    make_sofa,
    make_stool,
    make_table,
)
from depth_pose.sim.furniture.fixtures import make_boxes, make_curtain, make_door, make_lamp
from depth_pose.sim.furniture.home import (
    make_clothes_horse,
    make_counter,
    make_dining_table,
    make_hat_stand,
    make_low_table,
    make_pram,
    make_rug,
    make_television,
    make_tower,
    make_trolley,
)
from depth_pose.sim.materials import sample_dark
from depth_pose.sim.pets import make_walking_pet
from depth_pose.sim.rooms import Maker, Room, draw_thing, is_before
from depth_pose.sim.scene_view import View
from depth_pose.sim.shapes import Assembly

Array = NDArray[np.float64]

HOME_STANDING: tuple[tuple[Maker, float], ...] = (
    *((make, share) for make, share in STANDING),
    (make_dining_table, 3.0),
    (make_low_table, 2.0),
    (make_pram, 1.2),
    (make_trolley, 1.2),
    (make_tower, 1.6),
    (make_hat_stand, 1.8),
    (make_clothes_horse, 1.0),
    (make_curtain, 0.5),
    (make_walking_pet, 3.0),
    (make_lamp, 1.0),
    (make_sofa, 2.0),
)
"""Functions that make free-standing objects of homes, and their frequencies."""

HOME_AT_WALLS: tuple[tuple[Maker, float], ...] = (
    *((make, share) for make, share in AT_WALLS),
    (make_counter, 2.5),
    (make_television, 2.0),
    (make_hat_stand, 0.7),
    (make_curtain, 1.5),
    (make_plant, 0.8),
    (make_tower, 0.6),
)
"""Functions that make objects along the walls of homes, and their frequencies."""

HIDING: tuple[tuple[Maker, float], ...] = (
    (make_table, 2.0),
    (make_dining_table, 1.5),
    (make_counter, 1.5),
    (make_low_table, 1.0),
    (make_chair, 1.5),
    (make_stool, 0.5),
    (make_sofa, 1.0),
    (make_board, 1.5),
    (make_curtain, 1.2),
    (make_door, 1.0),
    (make_shelf, 0.7),
    (make_boxes, 1.0),
    (make_plant, 0.8),
    (make_clothes_horse, 0.7),
    (make_walking_pet, 0.5),
)
"""Functions that make what stands before people, and their frequencies."""

_PIECES = (15, 41)
"""Number of pieces that are tried: minimum, and exclusive maximum."""
_DARK_SHARE = 0.18
"""Share of pieces that return little light."""
_BEFORE_SHARE = 0.45
"""Share of people with an object in front of them."""
_TRIES = 5
"""Number of spots tried for each object."""
_CLEAR_M, _CLOSE = 1.6, 0.06
"""Most objects are at least this far ahead (m); the share of the others."""
_RUGS = 0.5
"""Share of homes with a rug."""


def furnish_home(
    room: Room, rng: np.random.Generator, avoid: Sequence[Array], view: View, reach: float
) -> None:
    """Fill a room as a home; nothing intersects people. Parameters are those of `rooms.furnish`."""
    if rng.random() < _RUGS:
        x, z = view.floor_spot(rng, rng.uniform(1.0, reach))
        room.shapes.add(make_rug(rng), x, 0.0, z, rng.uniform(0, np.pi))
    for points in avoid:
        if rng.random() < _BEFORE_SHARE:
            _put_before(room, rng, points, avoid)
    pieces = int(rng.integers(*_PIECES))
    for _ in range(round(0.4 * pieces)):
        room.put_at_wall(rng, dark_or_not(draw_thing(rng, HOME_AT_WALLS), rng), avoid)
    for _ in range(round(0.6 * pieces)):
        thing = dark_or_not(draw_thing(rng, HOME_STANDING), rng)
        for _ in range(_TRIES):
            away = (
                max(reach * np.sqrt(rng.uniform()), _CLEAR_M)
                if rng.random() > _CLOSE
                else rng.uniform(0.6, _CLEAR_M)
            )
            x, z = view.floor_spot(rng, away, 1.5)
            if is_before(thing, x, z, avoid) and rng.random() < 0.8:
                continue
            if room.walls.inward(x, z) > 0.2 and room.put(thing, x, z, rng.uniform(0, 2 * np.pi), avoid, 0.5):
                break


def dark_or_not(thing: Assembly, rng: np.random.Generator) -> Assembly:
    """Repaint some things with a material that returns little light."""
    if rng.random() < _DARK_SHARE:
        thing.repaint(sample_dark(rng))
    return thing


def _put_before(room: Room, rng: np.random.Generator, points: Array, avoid: Sequence[Array]) -> None:
    """Place an object between the camera and a person, most often close to the person."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    away = max(float(np.hypot(middle[0], middle[2])), 0.3)
    toward = -middle[[0, 2]] / away
    for _ in range(_TRIES):
        thing = dark_or_not(draw_thing(rng, HIDING), rng)
        low, high = thing.bounds()
        nearer = 0.5 * float(high[2] - low[2]) + rng.choice([rng.uniform(0.15, 0.5), rng.uniform(0.5, 2.0)])
        aside = rng.normal(0, 0.3) * np.array([toward[1], -toward[0]])
        x, z = middle[[0, 2]] + min(nearer, 0.8 * away) * toward + aside
        turn = np.arctan2(toward[0], toward[1]) + rng.normal(0, 0.35)
        if room.walls.inward(x, z) > 0.05 and room.put(thing, float(x), float(z), float(turn), avoid, 0.0):
            return
