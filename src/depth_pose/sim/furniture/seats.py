"""Chairs, stools, sofas and beds without anybody on them."""

from __future__ import annotations

import numpy as np

from depth_pose.sim.furniture.tables import add_clutter
from depth_pose.sim.shapes import Assembly, Kind, random_albedo


def make_chair(rng: np.random.Generator, seat: float | None = None, plain: bool = False) -> Assembly:
    """Make a chair that faces +z: four legs or an office chair, perhaps with a jacket over its back.

    Parameters
    ----------
    rng : numpy.random.Generator
    seat : float, optional
        Height of the seat, metres.
    plain : bool
        Without armrests and objects on it, for a person to sit on.
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
    """Add the base of a seat: a star on castors, or four legs."""
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


def make_bed(
    rng: np.random.Generator,
    high: float | None = None,
    bare: bool = False,
    size: tuple[float, float] | None = None,
) -> Assembly:
    """Make a bed along z, its head at -z, with pillows and perhaps a heaped blanket.

    Parameters
    ----------
    rng : numpy.random.Generator
    high : float, optional
        Height of the mattress, metres.
    bare : bool
        Without a blanket, for a person to lie or sit on.
    size : (float, float), optional
        Width and length, metres, for a person to lie in; such a bed has no pillow.
    """
    thing = Assembly(Kind.BED, random_albedo(rng, 0.05))
    top = rng.uniform(0.35, 0.6) if high is None else high
    wide, long = size or (float(rng.choice([0.9, 1.0, 1.4, 1.8])), 2.0)
    thing.box((0, top - 0.1, 0), (wide, 0.2, long))
    thing.box((0, top / 2 - 0.1, 0), (wide * 0.96, max(top - 0.2, 0.05), 0.98 * long))
    if rng.random() < 0.7:
        tall = top + rng.uniform(0.0, 0.6)
        thing.box((0, tall / 2, -long / 2 - 0.03), (wide + 0.05, tall, 0.05))
    if rng.random() < 0.3:
        tall = top + rng.uniform(-0.1, 0.3)
        thing.box((0, tall / 2, long / 2 + 0.03), (wide + 0.05, tall, 0.05))
    if size is not None:
        return thing
    for x in (-0.25, 0.25) if wide > 1.2 else (0.0,):
        thing.lump((x * wide, top + 0.03, -0.72), (0.32, 0.07, 0.2), 0.06)
    if not bare and rng.random() < 0.5:
        _heap_duvet(thing, rng, top, wide, long)
    elif not bare and rng.random() < 0.6:
        for _ in range(int(rng.integers(1, 5))):
            at = (rng.uniform(-0.3, 0.3) * wide, top + 0.02, rng.uniform(-0.4, 0.8))
            thing.lump(at, rng.uniform((0.2, 0.06, 0.2), (0.5, 0.16, 0.6)), 0.12, rng.uniform(0, 3))
    return thing


def _heap_duvet(thing: Assembly, rng: np.random.Generator, top: float, wide: float, long: float) -> None:
    """Place a crumpled blanket without a person under it on a bed."""
    first = rng.uniform(-0.4, 0.1) * long
    x, z = np.meshgrid(np.arange(-wide / 2, wide / 2, 0.05), np.arange(first, long / 2, 0.05))
    height = np.full(x.shape, rng.uniform(0.01, 0.04))
    for _ in range(int(rng.integers(2, 14))):
        at, size = rng.uniform((-wide / 2, first), (wide / 2, long / 2)), rng.uniform(0.06, 0.35, 2)
        turn, tall = rng.uniform(0, np.pi), rng.uniform(0.02, 0.22)
        a, b = np.cos(turn) * (x - at[0]) + np.sin(turn) * (z - at[1]), np.cos(turn) * (z - at[1])
        b -= np.sin(turn) * (x - at[0])
        height = np.maximum(height, tall * np.exp(-((a / size[0]) ** 2) - (b / size[1]) ** 2))
    thing.sheet(np.stack([x, top + height, z], axis=-1), albedo=random_albedo(rng, 0.1))
