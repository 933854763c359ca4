"""Objects in rooms: furniture, things on it, plants, doors, coats on stands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from depth_pose.sim.shapes import Assembly, Kind, random_albedo

Array = NDArray[np.float64]


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


def make_chair(rng: np.random.Generator, seat: float | None = None, plain: bool = False) -> Assembly:
    """Make a chair that faces +z: four legs or an office chair, perhaps with a jacket over its back.

    Parameters
    ----------
    rng : numpy.random.Generator
    seat : float, optional
        Height of the seat, metres.
    plain : bool
        Nothing hangs over or lies on it, and it has no arms: somebody sits there.
    """
    thing = Assembly(Kind.CHAIR, random_albedo(rng, 0.35))
    high = rng.uniform(0.42, 0.5) if seat is None else seat
    wide, deep = rng.uniform(0.38, 0.5), rng.uniform(0.38, 0.48)
    back, tilt = rng.uniform(0.3, 0.65), -rng.uniform(0.02, 0.3)
    office = rng.random() < 0.45
    thick = rng.uniform(0.05, 0.1) if office else rng.uniform(0.02, 0.05)
    thing.box((0, high - thick / 2, 0), (wide, thick, deep))
    lift = rng.uniform(0.05, 0.25)
    middle = high + lift + back / 2
    rear = -deep / 2 + np.sin(tilt) * (lift + back / 2)
    if not office and rng.random() < 0.4:
        for x in np.linspace(-0.45, 0.45, int(rng.integers(3, 6))) * wide:
            thing.box((x, middle, rear), (0.025, back, 0.02), 0.0, tilt)
        thing.box((0, high + lift + back, rear + np.sin(tilt) * back / 2), (wide, 0.07, 0.025), 0.0, tilt)
    elif rng.random() < 0.5:
        thing.lump((0, middle, rear), (wide * 0.5, back * 0.55, 0.05), 0.03)
    else:
        thing.box((0, middle, rear), (wide * rng.uniform(0.8, 1.0), back, thick), 0.0, tilt)
    thing.box((0, high + lift / 2, -deep / 2), (wide * 0.3, lift + 0.1, 0.03), 0.0, tilt)
    _put_under_seat(thing, rng, high, wide, deep, office)
    if rng.random() < 0.4 and not plain:
        for x in (-1, 1):
            thing.box((x * wide * 0.52, high + 0.2, -0.03), (0.05, 0.03, deep * 0.7))
            thing.box((x * wide * 0.52, high + 0.08, -0.03), (0.03, 0.24, 0.03))
    if rng.random() < 0.35 and not plain:
        thing.add(_jacket(rng, wide, high + lift + back - 0.02), 0, 0, rear)
    if rng.random() < 0.15 and not plain:
        add_clutter(thing, rng, 0.0, high, 0.0)
    return thing


def _put_under_seat(
    thing: Assembly, rng: np.random.Generator, high: float, wide: float, deep: float, office: bool
) -> None:
    """Add what carries a seat: a star on castors, or four legs."""
    if office:
        thing.bar((0, 0.08, 0), (0, high, 0), 0.03, None, None, 0.1)
        for angle in 2 * np.pi * np.arange(5) / 5 + rng.uniform(0, 1):
            foot = (0.3 * np.cos(angle), 0.05, 0.3 * np.sin(angle))
            thing.bar((0, 0.1, 0), foot, 0.025, None, None, 0.1)
        return
    leg, spread = rng.uniform(0.02, 0.045), rng.uniform(1.0, 1.2)
    for x in (-0.5, 0.5):
        for z in (-0.5, 0.5):
            top = (x * (wide - leg), high, z * (deep - leg))
            thing.bar((spread * top[0], 0, spread * top[2]), top, leg / 2)


def _jacket(rng: np.random.Generator, wide: float, top: float) -> Assembly:
    """Make a jacket over a chair back with its upper edge at `top`."""
    thing = Assembly(Kind.CHAIR, random_albedo(rng, 0.3))
    long, width = rng.uniform(0.4, 0.75), wide * rng.uniform(1.0, 1.2)
    down = np.linspace(0, 1, 9)[:, None]
    around = 2 * np.pi * np.arange(24)[None] / 24
    folds = 1 + 0.12 * down * np.sin(around * rng.integers(3, 7) + rng.uniform(0, 6, (9, 1)) * 0.3)
    x = width / 2 * np.cos(around) * folds * (0.85 + 0.15 * np.minimum(down * 4, 1))
    z = (0.04 + 0.05 * np.sqrt(down)) * np.sin(around) * folds
    y = np.broadcast_to(np.maximum(top + 0.02 - long * down, 0.03), x.shape)
    thing.sheet(np.stack([x, y, z], axis=-1), wraps=True)
    thing.lump((0, top, 0), (width * 0.42, 0.05, 0.07), 0.08)
    return thing


def make_stool(rng: np.random.Generator, seat: float | None = None) -> Assembly:
    """Make a stool, low or a bar's."""
    thing = Assembly(Kind.STOOL, random_albedo(rng))
    high, wide = (rng.uniform(0.4, 0.75) if seat is None else seat), rng.uniform(0.15, 0.22)
    thing.bar((0, high - 0.05, 0), (0, high, 0), wide)
    for angle in np.pi / 4 + np.pi / 2 * np.arange(4):
        x, z = np.cos(angle) * wide, np.sin(angle) * wide
        thing.bar((1.1 * x, 0, 1.1 * z), (0.7 * x, high, 0.7 * z), 0.015)
    return thing


def make_sofa(rng: np.random.Generator, seat: float | None = None, bare: bool = False) -> Assembly:
    """Make an armchair or sofa that faces +z; the middle of its seat is the origin."""
    thing = Assembly(Kind.SOFA, random_albedo(rng))
    wide, deep = rng.choice([0.65, 1.3, 1.9]) * rng.uniform(0.9, 1.1), rng.uniform(0.5, 0.62)
    high = rng.uniform(0.38, 0.46) if seat is None else seat
    back, arm = rng.uniform(0.3, 0.5), rng.uniform(0.1, 0.22)
    thing.box((0, high / 2, 0), (wide, high, deep))
    thing.box((0, (high + back) / 2, -deep / 2 - 0.1), (wide + 2 * arm, high + back, 0.2), 0, -0.08)
    for x in (-1, 1):
        thing.box((x * (wide + arm) / 2, high / 2 + 0.08, -0.05), (arm, high + 0.16, deep + 0.1))
    for x in np.linspace(-0.35, 0.35, int(rng.integers(0, 3))) * wide:
        if not bare:
            radii = (0.22, 0.2, 0.09)
            thing.lump(
                (x, high + 0.18, -deep / 2 + 0.08), radii, 0.05, rng.normal(0, 0.2), None, random_albedo(rng)
            )
    return thing


def make_bed(rng: np.random.Generator, high: float | None = None, bare: bool = False) -> Assembly:
    """Make a bed along z, its head at -z, with pillows and perhaps a heaped blanket."""
    thing = Assembly(Kind.BED, random_albedo(rng, 0.05))
    wide, top = rng.choice([0.9, 1.0, 1.4, 1.8]), (rng.uniform(0.35, 0.6) if high is None else high)
    thing.box((0, top - 0.1, 0), (wide, 0.2, 2.0))
    thing.box((0, top / 2 - 0.1, 0), (wide * 0.96, max(top - 0.2, 0.05), 1.96))
    if rng.random() < 0.7:
        tall = top + rng.uniform(0.0, 0.6)
        thing.box((0, tall / 2, -1.03), (wide + 0.05, tall, 0.05))
    if rng.random() < 0.3:
        tall = top + rng.uniform(-0.1, 0.3)
        thing.box((0, tall / 2, 1.03), (wide + 0.05, tall, 0.05))
    for x in (-0.25, 0.25) if wide > 1.2 else (0.0,):
        thing.lump((x * wide, top + 0.03, -0.72), (0.32, 0.07, 0.2), 0.06)
    if not bare and rng.random() < 0.6:
        for _ in range(int(rng.integers(1, 5))):
            at = (rng.uniform(-0.3, 0.3) * wide, top + 0.02, rng.uniform(-0.4, 0.8))
            thing.lump(at, rng.uniform((0.2, 0.06, 0.2), (0.5, 0.16, 0.6)), 0.12, rng.uniform(0, 3))
    return thing


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


STANDING: tuple[tuple[Callable[[np.random.Generator], Assembly], float], ...] = (
    (make_table, 4.0),
    (make_chair, 5.0),
    (make_stool, 0.7),
    (make_sofa, 1.2),
    (make_bed, 0.6),
    (make_shelf, 2.0),
    (make_plant, 1.2),
    (make_boxes, 1.6),
    (make_pillar, 1.2),
    (make_coats, 1.6),
    (make_lamp, 1.0),
    (make_bin, 0.8),
    (make_board, 1.2),
)
"""Makers of what stands about in a room, and how often each is taken."""

AT_WALLS: tuple[tuple[Callable[[np.random.Generator], Assembly], float], ...] = (
    (make_shelf, 3.0),
    (make_table, 1.5),
    (make_sofa, 0.8),
    (make_door, 2.0),
    (make_curtain, 2.0),
    (make_pipes, 1.2),
    (make_board, 1.0),
    (make_coats, 1.0),
    (make_chair, 1.0),
)
"""Makers of what stands or hangs along the walls."""
