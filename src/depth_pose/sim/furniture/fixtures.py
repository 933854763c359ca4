"""Shelves, doors, plants, boxes, curtains, pillars, coats, lamps, bins, pipes and boards."""

from __future__ import annotations

import numpy as np

from depth_pose.sim.furniture.tables import add_clutter
from depth_pose.sim.shapes import Assembly, Kind, random_albedo


def make_shelf(rng: np.random.Generator) -> Assembly:
    """Make a shelf, cupboard or rack with things on its boards."""
    thing = Assembly(Kind.SHELF, random_albedo(rng))
    wide, deep, tall = rng.uniform(0.4, 1.6), rng.uniform(0.25, 0.5), rng.uniform(0.7, 2.2)
    if rng.random() < 0.35:
        thing.box((0, tall / 2, 0), (wide, tall, deep))
        for _ in range(int(rng.integers(0, 4))):
            add_clutter(thing, rng, rng.uniform(-0.4, 0.4) * wide, tall, 0.0)
        return thing
    for x in (-0.5, 0.5):
        thing.box((x * wide, tall / 2, 0), (0.025, tall, deep))
    if rng.random() < 0.7:
        thing.box((0, tall / 2, -deep / 2), (wide, tall, 0.015))
    boards = np.linspace(0.08, tall, int(rng.integers(3, 7)))
    for y in boards:
        thing.box((0, y, 0), (wide, 0.025, deep))
        for x in np.arange(-0.45, 0.45, rng.uniform(0.08, 0.4) / wide):
            if y < tall and rng.random() < 0.6:
                size = rng.uniform((0.03, 0.1, 0.1), (0.2, 0.3, 0.3))
                at = (x * wide, y + size[1] / 2, rng.uniform(-0.05, 0.03))
                thing.box(at, size, 0, 0, Kind.CLUTTER, random_albedo(rng, 0.3))
    return thing


def make_door(rng: np.random.Generator) -> Assembly:
    """Make a door in its frame, ajar, in the plane z = 0."""
    thing = Assembly(Kind.DOOR, random_albedo(rng, 0.1))
    wide, tall = rng.uniform(0.75, 1.0), rng.uniform(1.95, 2.15)
    for x in (-0.5, 0.5):
        thing.box((x * (wide + 0.08), tall / 2, 0), (0.08, tall, 0.14))
    thing.box((0, tall + 0.04, 0), (wide + 0.16, 0.08, 0.14))
    turn = rng.choice([0.0, rng.uniform(0.1, 2.0)])
    c, s = np.cos(turn), np.sin(turn)
    thing.box(((c - 1) * wide / 2, tall / 2, s * wide / 2), (wide, tall, 0.045), -turn)
    reach = 0.45 * wide
    thing.bar(
        (c * wide / 2 - wide / 2 + c * reach, 1.03, s * (wide / 2 + reach) + 0.05),
        (c * wide / 2 - wide / 2 + c * (reach - 0.1), 1.03, s * (wide / 2 + reach) + 0.07), 0.012,
    )  # fmt: skip
    return thing


def make_plant(rng: np.random.Generator) -> Assembly:
    """Make a potted plant: leaves in a crown, or long blades."""
    thing = Assembly(Kind.PLANT, random_albedo(rng, 0.1))
    tall, pot = rng.uniform(0.4, 1.9), rng.uniform(0.1, 0.2)
    thing.bar((0, 0, 0), (0, 1.8 * pot, 0), 0.8 * pot, pot)
    crown = rng.uniform(0.15, 0.45)
    if rng.random() < 0.5:
        thing.bar((0, 0, 0), (0, tall, 0), 0.015)
        for _ in range(int(rng.integers(12, 40))):
            out = rng.normal(0, 1, 3)
            at = out / np.linalg.norm(out) * crown * rng.uniform(0.4, 1.0) + (0, tall - crown / 2, 0)
            radii = rng.uniform((0.04, 0.01, 0.03), (0.12, 0.03, 0.08))
            thing.lump((at[0], max(at[1], 0.1), at[2]), radii, 0.2, rng.uniform(0, 6))
        return thing
    for angle in rng.uniform(0, 2 * np.pi, int(rng.integers(8, 24))):
        bend, rise = rng.uniform(0.3, 1.0) * crown * 1.5, rng.uniform(0.5, 1.0) * tall
        t = np.linspace(0, 1, 6)[:, None]
        side = 0.03 * np.sin(np.pi * np.clip(t, 0.05, 0.95)) * np.array([[-1.0, 1.0]])
        x = np.cos(angle) * bend * t**2 - np.sin(angle) * side
        z = np.sin(angle) * bend * t**2 + np.cos(angle) * side
        y = np.broadcast_to(1.6 * pot + (rise - 1.6 * pot) * (t - 0.3 * t**3), x.shape)
        thing.sheet(np.stack([x, y, z], axis=-1))
    return thing


def make_boxes(rng: np.random.Generator) -> Assembly:
    """Make a stack of boxes, cases or bags on the floor."""
    thing = Assembly(Kind.BOX, random_albedo(rng))
    high, turn = 0.0, rng.uniform(0, np.pi)
    for _ in range(int(rng.integers(1, 4))):
        size = rng.uniform((0.2, 0.12, 0.2), (0.7, 0.6, 0.6))
        at = (rng.normal(0, 0.03), high + size[1] / 2, rng.normal(0, 0.03))
        if rng.random() < 0.25:
            thing.lump(at, size / 2, 0.12, turn, None, random_albedo(rng))
        else:
            thing.box(at, size, turn + rng.normal(0, 0.1), 0.0, None, random_albedo(rng))
        high += size[1]
    return thing


def make_curtain(rng: np.random.Generator) -> Assembly:
    """Make a hanging curtain with folds in the plane z = 0."""
    thing = Assembly(Kind.CURTAIN, random_albedo(rng, 0.1))
    wide, tall = rng.uniform(0.3, 2.5), rng.uniform(1.6, 2.6)
    columns = int(np.clip(wide / 0.025, 12, 90))
    x = np.linspace(-0.5, 0.5, columns)[None] * wide
    down = np.linspace(0, 1, 8)[:, None]
    pleat = 2 * np.pi / rng.uniform(0.1, 0.3)
    deep = rng.uniform(0.02, 0.07)
    z = deep * (0.4 + 0.6 * down) * np.sin(pleat * x + 1.5 * np.sin(3 * x + rng.uniform(0, 6)) + 0.4 * down)
    y = np.broadcast_to(tall * (1 - down) + rng.choice([0.02, 0.6]) * down, z.shape)
    thing.sheet(np.stack([np.broadcast_to(x, z.shape), y, z], axis=-1))
    return thing


def make_pillar(rng: np.random.Generator) -> Assembly:
    """Make a pillar, a post, or something tall and narrow as high as a person."""
    thing = Assembly(Kind.PILLAR, random_albedo(rng, 0.1))
    tall, wide = rng.choice([3.2, rng.uniform(0.9, 2.0)]), rng.uniform(0.1, 0.5)
    if rng.random() < 0.5:
        thing.bar((0, 0, 0), (0, tall, 0), wide / 2, wide / 2 * rng.uniform(0.7, 1.1))
    else:
        thing.box((0, tall / 2, 0), (wide, tall, rng.uniform(0.1, 0.5)))
    return thing


def make_coats(rng: np.random.Generator) -> Assembly:
    """Make a coat stand or hooks with coats and bags that hang from it."""
    thing = Assembly(Kind.COATS, random_albedo(rng))
    tall = rng.uniform(1.5, 1.95)
    thing.bar((0, 0, 0), (0, tall, 0), 0.02)
    thing.bar((0, 0, 0), (0, 0.03, 0), rng.uniform(0.15, 0.25))
    for angle in rng.uniform(0, 2 * np.pi, int(rng.integers(1, 4))):
        x, z = 0.1 * np.cos(angle), 0.1 * np.sin(angle)
        thing.bar((0, tall - 0.15, 0), (1.5 * x, tall - 0.05, 1.5 * z), 0.012)
        _hang_coat(thing, rng, x, tall - rng.uniform(0.05, 0.15), z, angle)
    if rng.random() < 0.25:  # a hat on the top
        thing.bar((0, tall - 0.02, 0), (0, tall, 0), 0.15)
    return thing


def _hang_coat(
    thing: Assembly, rng: np.random.Generator, x: float, top: float, z: float, angle: float
) -> None:
    """Hang one coat, a flattened tube with folds that widens below its hook."""
    long, wide, thick = rng.uniform(0.5, 1.15), rng.uniform(0.14, 0.26), rng.uniform(0.06, 0.13)
    down = np.linspace(0, 1, 12)[:, None]
    around = 2 * np.pi * np.arange(20)[None] / 20
    open_out = np.minimum(0.15 + 4.0 * down, 1.0) ** 0.6 * (1 + rng.uniform(-0.2, 0.3) * down)
    folds = 1 + 0.15 * down * np.sin(around * rng.integers(3, 8) + 2 * down)
    a, b = wide * open_out * np.cos(around) * folds, thick * open_out * np.sin(around) * folds
    c, s = np.cos(angle + np.pi / 2), np.sin(angle + np.pi / 2)
    points = np.stack(
        [x + c * a - s * b, np.broadcast_to(top - long * down, a.shape), z + s * a + c * b], axis=-1
    )
    thing.sheet(points, wraps=True, albedo=random_albedo(rng, 0.35))


def make_lamp(rng: np.random.Generator) -> Assembly:
    """Make a standing lamp, a fan or a tripod."""
    thing = Assembly(Kind.LAMP, random_albedo(rng))
    tall, shade = rng.uniform(1.0, 1.9), rng.uniform(0.1, 0.25)
    lean = rng.uniform(0, 0.3)
    if rng.random() < 0.3:
        for angle in 2 * np.pi / 3 * np.arange(3) + rng.uniform(0, 2):
            thing.bar((0.35 * np.cos(angle), 0, 0.35 * np.sin(angle)), (0, 0.8 * tall, 0), 0.014)
        thing.box((0, 0.85 * tall, 0), (0.15, 0.12, 0.18), rng.uniform(0, 3))
        return thing
    thing.bar((0, 0, 0), (0, 0.03, 0), 0.15)
    thing.bar((0, 0, 0), (lean, tall, 0), 0.014)
    thing.bar((lean, tall - 0.2, 0), (lean, tall + 0.05, 0), shade, shade * rng.uniform(0.4, 1.0))
    return thing


def make_bin(rng: np.random.Generator) -> Assembly:
    """Make a bin, bucket, bag or ball on the floor."""
    thing = Assembly(Kind.BIN, random_albedo(rng, 0.3))
    tall, wide = rng.uniform(0.2, 0.8), rng.uniform(0.1, 0.25)
    if rng.random() < 0.7:
        thing.bar((0, 0, 0), (0, tall, 0), 0.85 * wide, wide)
    else:
        thing.lump((0, wide, 0), (wide, wide, wide * rng.uniform(0.6, 1)), 0.08)
    return thing


def make_pipes(rng: np.random.Generator) -> Assembly:
    """Make pipes, ducts, rails or hanging cables near the plane z = 0, with a radiator at times."""
    thing = Assembly(Kind.PIPE, random_albedo(rng))
    for _ in range(int(rng.integers(1, 4))):
        x, r = rng.uniform(-0.5, 0.5), rng.uniform(0.01, 0.08)
        if rng.random() < 0.5:
            thing.bar((x, 0, 0.1), (x, 3.2, 0.1), r)
        else:
            y = rng.uniform(0.4, 2.6)
            thing.bar((-1.5, y, 0.1), (1.5, y + rng.normal(0, 0.1), 0.1), r)
    if rng.random() < 0.4:
        for x in np.arange(-0.5, 0.5, 0.08):
            thing.box((x, 0.45, 0.08), (0.05, 0.6, 0.1))
    return thing


def make_board(rng: np.random.Generator) -> Assembly:
    """Make a board on feet, an easel, a roll-up banner, or a panel that leans."""
    thing = Assembly(Kind.BOARD, random_albedo(rng, 0.1))
    wide, tall = rng.uniform(0.4, 1.6), rng.uniform(0.7, 1.4)
    foot = rng.choice([0.02, rng.uniform(0.4, 0.9)])
    tilt = -rng.uniform(0, 0.25)
    thing.box((0, foot + tall / 2, 0), (wide, tall, 0.03), 0, tilt)
    for x in (-0.45, 0.45):
        thing.bar((x * wide, 0, 0.25), (x * wide, foot + tall * 0.8, -0.02), 0.015)
        thing.bar((x * wide, 0, -0.25), (x * wide, foot + tall * 0.5, -0.02), 0.015)
    return thing
