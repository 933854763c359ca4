"""Tables and desks, and the objects on them."""

from __future__ import annotations

import numpy as np

from depth_pose.sim.shapes import Assembly, Kind, random_albedo


def make_table(rng: np.random.Generator, height: float | None = None) -> Assembly:
    """Make a table or desk, perhaps with a front panel, drawers and things on it."""
    thing = Assembly(Kind.TABLE, random_albedo(rng))
    wide, deep = rng.uniform(0.7, 2.0), rng.uniform(0.5, 0.9)
    top = rng.uniform(0.68, 0.78) if height is None else height
    if rng.random() < 0.15:
        thing.bar((0, top - 0.03, 0), (0, top, 0), deep * 0.6)
        thing.bar((0, 0, 0), (0, top, 0), 0.04)
        thing.bar((0, 0, 0), (0, 0.03, 0), deep * 0.35)
        wide = deep = deep * 0.8
    else:
        thing.box((0, top - 0.015, 0), (wide, 0.03, deep))
        legs = rng.uniform(0.03, 0.07)
        for x in (-1, 1):
            for z in (-1, 1):
                thing.box((x * (wide / 2 - legs), top / 2, z * (deep / 2 - legs)), (legs, top, legs))
        if rng.random() < 0.3:
            thing.box((0, top * 0.6, -deep / 2 + 0.03), (wide, top * 0.7, 0.02))
        if rng.random() < 0.35:
            thing.box((rng.choice([-1, 1]) * (wide / 2 - 0.22), top / 2, 0), (0.4, top, deep * 0.9))
    _put_things(thing, rng, top, wide, deep)
    return thing


def make_desk(rng: np.random.Generator, height: float) -> Assembly:
    """Make a desk on which much stands, seen from behind it: screens, piles, boxes, perhaps a partition."""
    thing = Assembly(Kind.TABLE, random_albedo(rng))
    wide, deep, top = rng.uniform(1.1, 2.0), rng.uniform(0.6, 0.9), height
    thing.box((0, top - 0.015, 0), (wide, 0.03, deep))
    for x in (-1, 1):
        thing.box((x * (wide / 2 - 0.02), top / 2, 0), (0.04, top, deep * rng.uniform(0.1, 0.95)))
    if rng.random() < 0.6:
        panel = top * rng.uniform(0.4, 1.0)
        thing.box((0, top - panel / 2, -deep / 2 + 0.03), (wide, panel, 0.02))
    if rng.random() < 0.25:
        tall = rng.uniform(0.2, 0.5)
        thing.box((0, top + tall / 2, -deep / 2), (wide, tall, 0.03), 0.0, 0.0, None, random_albedo(rng))
    screens = int(rng.integers(1, 4))
    for x in np.linspace(-0.5, 0.5, screens + 2)[1:-1] * wide:
        thing.add(make_monitor(rng), x + rng.normal(0, 0.05), top, -deep * 0.3, rng.normal(0, 0.3))
    for _ in range(int(rng.integers(2, 7))):
        size = rng.uniform((0.1, 0.08, 0.1), (0.45, 0.45, 0.4))
        spot = (rng.uniform(-0.45, 0.45) * wide, top + size[1] / 2, rng.uniform(-0.45, 0.1) * deep)
        thing.box(spot, size, rng.normal(0, 0.3), 0.0, Kind.CLUTTER, random_albedo(rng))
    for _ in range(int(rng.integers(3, 10))):
        add_clutter(thing, rng, rng.uniform(-0.47, 0.47) * wide, top, rng.uniform(-0.45, 0.2) * deep)
    return thing


def _put_things(thing: Assembly, rng: np.random.Generator, top: float, wide: float, deep: float) -> None:
    """Lay monitors, keyboards, boxes, bottles and heaps on a table's top."""
    if rng.random() < 0.55:
        for x in np.linspace(-0.3, 0.3, int(rng.integers(1, 3))) * wide:
            if rng.random() < 0.7:
                thing.add(make_monitor(rng), x, top, -deep * 0.25, rng.normal(0, 0.3))
            else:
                thing.add(make_laptop(rng), x, top, 0.0, rng.normal(0, 0.3))
            thing.box(
                (x, top + 0.012, deep * 0.2), (0.42, 0.025, 0.14), rng.normal(0, 0.1), 0, Kind.CLUTTER, 0.06
            )
    for _ in range(int(rng.integers(0, 14))):
        add_clutter(thing, rng, rng.uniform(-0.45, 0.45) * wide, top, rng.uniform(-0.4, 0.4) * deep)


def add_clutter(thing: Assembly, rng: np.random.Generator, x: float, y: float, z: float) -> None:
    """Place one small object: a box, a pile, a bottle, a bag, a lamp."""
    what, share, turn = rng.integers(0, 5), random_albedo(rng, 0.35), rng.uniform(0, np.pi)
    if what <= 1:
        size = rng.uniform((0.04, 0.02, 0.04), (0.32, 0.3, 0.3))
        thing.box((x, y + size[1] / 2, z), size, turn, 0.0, Kind.CLUTTER, share)
    elif what == 2:
        tall = rng.uniform(0.08, 0.32)
        thing.bar((x, y, z), (x, y + tall, z), rng.uniform(0.03, 0.08), None, Kind.CLUTTER, share)
    elif what == 3:
        radii = rng.uniform((0.06, 0.05, 0.06), (0.25, 0.16, 0.2))
        thing.lump((x, y + 0.8 * radii[1], z), radii, 0.18, turn, Kind.CLUTTER, share)
    else:
        tall, lean = rng.uniform(0.25, 0.5), rng.uniform(-0.2, 0.2)
        thing.bar((x, y, z), (x + lean, y + tall, z), 0.012, None, Kind.LAMP, share)
        thing.bar(
            (x + lean, y + tall, z), (x + 1.5 * lean, y + tall - 0.1, z + 0.05), 0.03, 0.09, Kind.LAMP, share
        )


def make_monitor(rng: np.random.Generator) -> Assembly:
    """Make a flat screen on its foot; the screen is almost black to infrared."""
    thing = Assembly(Kind.MONITOR, rng.uniform(0.01, 0.1))
    wide, tall = rng.uniform(0.4, 0.7), rng.uniform(0.26, 0.4)
    lift = rng.uniform(0.08, 0.2)
    thing.box((0, lift + tall / 2, 0), (wide, tall, 0.04), 0.0, rng.normal(0, 0.08))
    thing.bar((0, 0, -0.04), (0, lift + 0.1, -0.04), 0.025)
    thing.box((0, 0.01, -0.03), (0.24, 0.02, 0.18))
    return thing


def make_laptop(rng: np.random.Generator) -> Assembly:
    """Make an open laptop."""
    thing = Assembly(Kind.MONITOR, rng.uniform(0.02, 0.5))
    wide, deep = rng.uniform(0.3, 0.4), rng.uniform(0.2, 0.27)
    tilt = -rng.uniform(0.1, 0.5)
    thing.box((0, 0.01, 0), (wide, 0.02, deep))
    back = -deep / 2 + np.sin(tilt) * deep / 2
    thing.box((0, 0.02 + np.cos(tilt) * deep / 2, back), (wide, deep, 0.01), 0.0, tilt, None, 0.04)
    return thing
