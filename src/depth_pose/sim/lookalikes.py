"""Objects that a people finder confuses with people: clothes on hooks, heaps of them, dressed chairs.

Rooms full of them train the nets to separate people from objects (``tools/people_finder/find_sightings.py``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.sim.furniture import make_chair, make_coats, make_plant, make_table
from depth_pose.sim.rooms import Room
from depth_pose.sim.scene_view import View
from depth_pose.sim.shapes import Assembly, Kind, random_albedo

Array = NDArray[np.float64]

_MANY = (2, 8)
"""Number of lookalikes in a room: minimum, and exclusive maximum."""

_TRIES = 8
"""Number of spots tried for each."""


def add_lookalikes(room: Room, rng: np.random.Generator, view: View, reach: float) -> None:
    """Place some lookalikes in view of the camera, sometimes behind a table.

    Parameters are those of `depth_pose.sim.rooms.furnish`.
    """
    makers = (make_hung_clothes, make_hung_clothes, make_heap, make_dressed_chair, make_coats, make_plant)
    for _ in range(int(rng.integers(*_MANY))):
        thing = makers[int(rng.integers(len(makers)))](rng)
        for _ in range(_TRIES):
            x, z = view.floor_spot(rng, rng.uniform(0.8, 1.0 + reach), 1.0)
            turn = np.pi + rng.normal(0, 0.7)
            if room.walls.inward(x, z) > 0.2 and room.put(thing, x, z, turn, (), 0.3):
                if rng.random() < 0.5:
                    share = rng.uniform(0.5, 0.85)
                    room.put(make_table(rng), share * x, share * z, np.pi + rng.normal(0, 0.5), (), 0.0)
                break


def make_hung_clothes(rng: np.random.Generator) -> Assembly:
    """Make clothes on hooks: narrow at the top, with folds, hoods, empty sleeves, and others beside them.

    Half of them hang on a board of their own.
    """
    thing = Assembly(Kind.COATS, random_albedo(rng, 0.35))
    top, beside = rng.uniform(1.2, 1.95), rng.uniform(0.1, 0.4)
    count = int(rng.integers(1, 5))
    for k in range(count):
        _hang(thing, rng, (k - 0.5 * (count - 1)) * beside, top + rng.normal(0, 0.05))
    if rng.random() < 0.5:
        thing.box((0, 0.5 * top + 0.1, -0.2), (beside * count + 0.3, top + 0.2, 0.03))
    return thing


def _hang(thing: Assembly, rng: np.random.Generator, x: float, top: float) -> None:
    """Hang a garment before the plane z = 0."""
    long, wide, thick = rng.uniform(0.4, 1.25), rng.uniform(0.1, 0.34), rng.uniform(0.05, 0.16)
    down = np.linspace(0, 1, 14)[:, None]
    around = 2 * np.pi * np.arange(24)[None] / 24
    profile = np.minimum(rng.uniform(0.05, 0.5) + rng.uniform(1.0, 5.0) * down, 1.0) ** rng.uniform(0.5, 1.6)
    profile = profile * (1 + rng.uniform(-0.3, 0.4) * down)
    folds = 1 + rng.uniform(0.05, 0.3) * down * np.sin(around * rng.integers(2, 9) + rng.uniform(0, 4) * down)
    lean = rng.normal(0, 0.06) * down
    points = np.stack(
        [
            x + lean + wide * profile * np.cos(around) * folds,
            np.broadcast_to(top - long * down, folds.shape),
            thick * profile * np.sin(around) * folds,
        ],
        axis=-1,
    )
    albedo = random_albedo(rng, 0.35)
    thing.sheet(points, wraps=True, albedo=albedo)
    if rng.random() < 0.35:  # a hood
        radii = rng.uniform((0.06, 0.06, 0.05), (0.14, 0.16, 0.11))
        at = (x + rng.normal(0, 0.05), top - rng.uniform(0.0, 0.2), thick + 0.02)
        thing.lump(at, radii, rng.uniform(0.1, 0.35), albedo=albedo)
    for side in (-1, 1):
        if rng.random() < 0.4:  # an empty sleeve
            shoulder = (x + side * 0.6 * wide, top - rng.uniform(0.1, 0.25), 0.5 * thick)
            cuff = (x + side * (wide + rng.uniform(-0.05, 0.1)), top - min(long, 0.75), 0.6 * thick)
            thing.bar(shoulder, cuff, rng.uniform(0.05, 0.08), rng.uniform(0.03, 0.07), albedo=albedo)


def make_heap(rng: np.random.Generator) -> Assembly:
    """Make a heap of clothes, cushions or bags, on the floor or on a box."""
    thing = Assembly(Kind.BIN, random_albedo(rng, 0.3))
    high = 0.0
    if rng.random() < 0.6:
        wide, high, deep = rng.uniform((0.4, 0.3, 0.4), (1.2, 0.9, 0.7))
        thing.box((0, high / 2, 0), (wide, high, deep))
    for _ in range(int(rng.integers(1, 6))):
        radii = rng.uniform((0.12, 0.08, 0.1), (0.4, 0.25, 0.3))
        at = (rng.normal(0, 0.15), high + 0.8 * radii[1], rng.normal(0, 0.1))
        thing.lump(at, radii, rng.uniform(0.1, 0.4), rng.uniform(0, np.pi), albedo=random_albedo(rng, 0.3))
        high += rng.uniform(0.4, 1.4) * radii[1]
    return thing


def make_dressed_chair(rng: np.random.Generator) -> Assembly:
    """Make a chair with a garment over its back and, at times, a heap on its seat."""
    thing = make_chair(rng)
    coat = Assembly(Kind.CHAIR, random_albedo(rng, 0.35))
    _hang(coat, rng, 0.0, rng.uniform(0.85, 1.15))
    thing.add(coat, 0.0, 0.0, -0.2)
    if rng.random() < 0.4:
        radii = rng.uniform((0.12, 0.1, 0.1), (0.25, 0.25, 0.2))
        thing.lump((0.0, 0.45 + radii[1], 0.0), radii, rng.uniform(0.1, 0.35), albedo=random_albedo(rng, 0.3))
    return thing
