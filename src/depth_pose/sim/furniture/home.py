"""Objects of homes: prams, trolleys, towers of boxes, coat stands with hats, counters, televisions."""

from __future__ import annotations

import numpy as np

from depth_pose.sim.furniture.fixtures import make_coats
from depth_pose.sim.furniture.seats import make_chair
from depth_pose.sim.furniture.tables import add_clutter, make_table
from depth_pose.sim.materials import sample_dark, sample_reflectance
from depth_pose.sim.shapes import Assembly, Kind, random_albedo


def make_pram(rng: np.random.Generator) -> Assembly:
    """Make a pram or buggy: four wheels, a carrycot or seat with a hood, a handle."""
    thing = Assembly(Kind.AID, random_albedo(rng, 0.3))
    high, half, long = rng.uniform(0.5, 0.65), rng.uniform(0.2, 0.28), rng.uniform(0.35, 0.45)
    cloth = sample_dark(rng) if rng.random() < 0.5 else random_albedo(rng)
    for x in (-half, half):
        for z, radius in ((-long, rng.uniform(0.1, 0.16)), (long, rng.uniform(0.08, 0.14))):
            thing.bar((x - 0.02, radius, z), (x + 0.02, radius, z), radius, albedo=0.02)
            thing.bar((x, radius, z), (x, high, -0.3 * z), 0.012)
        thing.bar((x, high, -long * 0.6), (x, rng.uniform(0.95, 1.1), -long - 0.25), 0.014)
    thing.bar((-half, 1.0, -long - 0.24), (half, 1.0, -long - 0.24), 0.018, albedo=0.02)
    thing.box((0, high + 0.1, 0), (1.7 * half, 0.2, 1.7 * long), 0.0, rng.uniform(-0.25, 0.0), albedo=cloth)
    hood = (0.9 * half, rng.uniform(0.2, 0.3), 0.45 * long)
    thing.lump((0, high + 0.24, -0.6 * long), hood, 0.03, albedo=cloth)
    if rng.random() < 0.5:  # a shopping basket below
        thing.box((0, 0.25, 0), (1.5 * half, 0.14, 1.2 * long), albedo=random_albedo(rng, 0.4))
    return thing


def make_trolley(rng: np.random.Generator) -> Assembly:
    """Make a trolley or sack truck with boxes on it, up to the height of a person."""
    thing = Assembly(Kind.BOX, random_albedo(rng, 0.3))
    wide, deep = rng.uniform(0.4, 0.7), rng.uniform(0.35, 0.9)
    for x in (-0.45, 0.45):
        for z in (-0.4, 0.4):
            thing.bar((x * wide - 0.02, 0.06, z * deep), (x * wide + 0.02, 0.06, z * deep), 0.06, albedo=0.03)
        thing.bar((x * wide, 0.12, -deep / 2), (x * wide, rng.uniform(0.9, 1.2), -deep / 2 - 0.1), 0.015)
    thing.box((0, 0.14, 0), (wide, 0.04, deep))
    thing.bar((-0.45 * wide, 1.0, -deep / 2 - 0.1), (0.45 * wide, 1.0, -deep / 2 - 0.1), 0.015)
    _pile(thing, rng, 0.16, rng.uniform(0.5, 1.75), (wide, deep))
    return thing


def make_tower(rng: np.random.Generator) -> Assembly:
    """Make a stack of boxes as high as a child or an adult."""
    thing = Assembly(Kind.BOX, random_albedo(rng))
    size = rng.uniform(0.25, 0.6), rng.uniform(0.25, 0.5)
    _pile(thing, rng, 0.0, rng.uniform(0.7, 1.9), size)
    return thing


def _pile(thing: Assembly, rng: np.random.Generator, y: float, top: float, size: tuple[float, float]) -> None:
    """Stack boxes from a height up to another; higher ones are rarely larger."""
    wide, deep = size
    while y < top - 0.1:
        tall = min(rng.uniform(0.15, 0.5), top - y)
        at = (rng.normal(0, 0.03), y + tall / 2, rng.normal(0, 0.03))
        share = rng.uniform(0.75, 1.02)
        wide, deep = wide * share, deep * share
        albedo = sample_dark(rng) if rng.random() < 0.15 else random_albedo(rng)
        if rng.random() < 0.12:
            thing.lump(at, (0.5 * wide, 0.55 * tall, 0.5 * deep), 0.08, albedo=albedo)
        else:
            thing.box(at, (wide, tall, deep), rng.normal(0, 0.15), albedo=albedo)
        y += tall


def make_hat_stand(rng: np.random.Generator) -> Assembly:
    """Make a coat stand with coats, and a hat or helmet where a person's head would be."""
    thing = make_coats(rng)
    _, top = thing.bounds()
    y = float(top[1]) - rng.uniform(-0.05, 0.12)
    albedo = sample_dark(rng) if rng.random() < 0.4 else random_albedo(rng)
    radius = rng.uniform(0.085, 0.13)
    at = (rng.normal(0, 0.05), y, rng.normal(0, 0.05))
    thing.lump(at, (radius, rng.uniform(0.07, 0.13), 1.15 * radius), 0.05, albedo=albedo)
    if rng.random() < 0.6:
        brim = radius + rng.uniform(0.03, 0.1)
        thing.bar((at[0], y - 0.05, at[2]), (at[0], y - 0.035, at[2]), brim, albedo=albedo)
    return thing


def make_counter(rng: np.random.Generator) -> Assembly:
    """Make a kitchen counter or bar with things on it, and perhaps cupboards above it."""
    thing = Assembly(Kind.TABLE, random_albedo(rng, 0.1))
    wide, deep, top = rng.uniform(1.0, 3.0), rng.uniform(0.5, 0.7), rng.uniform(0.85, 1.1)
    thing.box((0, top / 2, 0), (wide, top, 0.92 * deep))
    thing.box((0, top, 0), (wide + 0.04, 0.04, deep), albedo=random_albedo(rng, 0.2))
    if rng.random() < 0.5:  # the oven's window
        at = (rng.uniform(-0.3, 0.3) * wide, 0.5 * top, 0.47 * deep)
        thing.box(at, (0.5, 0.4, 0.02), albedo=sample_reflectance(rng, "glass"))
    if rng.random() < 0.4:
        thing.box((0, 1.85, -0.2 * deep), (wide, 0.7, 0.35))
    for _ in range(int(rng.integers(0, 8))):
        add_clutter(thing, rng, rng.uniform(-0.45, 0.45) * wide, top, rng.uniform(-0.35, 0.35) * deep)
    return thing


def make_television(rng: np.random.Generator) -> Assembly:
    """Make a television on a low board; its screen returns nothing, its frame little."""
    thing = Assembly(Kind.MONITOR, random_albedo(rng, 0.3))
    wide, low = rng.uniform(0.8, 1.6), rng.uniform(0.35, 0.6)
    tall, deep = 0.57 * wide, rng.uniform(0.35, 0.5)
    screen = sample_reflectance(rng, "screen")
    thing.box((0, low / 2, 0), (1.2 * wide, low, deep))
    thing.box((0, low + 0.08 + tall / 2, 0), (wide, tall, 0.05), albedo=screen)
    thing.box((0, low + 0.04, 0), (0.35 * wide, 0.08, 0.2), albedo=0.02)
    for _ in range(int(rng.integers(0, 4))):
        add_clutter(thing, rng, rng.uniform(-0.55, 0.55) * wide, low, 0.35 * deep)
    return thing


def make_dining_table(rng: np.random.Generator) -> Assembly:
    """Make a table with two to six chairs around it."""
    thing, table = Assembly(Kind.TABLE), make_table(rng)
    low, high = table.bounds()
    thing.add(table)
    spots = [
        (x, side * (float(high[2]) + rng.uniform(-0.1, 0.3)), 0.0 if side < 0 else np.pi)
        for side in (-1, 1)
        for x in np.arange(float(low[0]) + 0.3, float(high[0]) - 0.2, 0.65)
    ]
    for x, z, turn in spots:
        if rng.random() < 0.75:
            thing.add(make_chair(rng), float(x), 0.0, float(z), turn + rng.normal(0, 0.25))
    return thing


def make_low_table(rng: np.random.Generator) -> Assembly:
    """Make a coffee table."""
    return make_table(rng, rng.uniform(0.35, 0.5))


def make_rug(rng: np.random.Generator) -> Assembly:
    """Make a rug, half of them dark."""
    thing = Assembly(Kind.FLOOR, sample_dark(rng) if rng.random() < 0.5 else random_albedo(rng))
    thing.box((0, 0.004, 0), (rng.uniform(0.8, 3.0), 0.008, rng.uniform(0.6, 2.2)))
    return thing


def make_clothes_horse(rng: np.random.Generator) -> Assembly:
    """Make a drying rack with laundry over its rails."""
    thing = Assembly(Kind.COATS, random_albedo(rng))
    wide, top, deep = rng.uniform(0.6, 1.2), rng.uniform(0.85, 1.3), rng.uniform(0.4, 0.6)
    for x in (-wide / 2, wide / 2):
        thing.bar((x, 0, -deep / 2), (x, top, deep / 2), 0.01)
        thing.bar((x, 0, deep / 2), (x, top, -deep / 2), 0.01)
    for z in np.linspace(-deep / 2, deep / 2, int(rng.integers(2, 5))):
        thing.bar((-wide / 2, top, z), (wide / 2, top, z), 0.006)
        if rng.random() < 0.7:
            _hang_over(thing, rng, top, float(z), rng.uniform(0.25, 0.8) * wide)
    return thing


def _hang_over(thing: Assembly, rng: np.random.Generator, top: float, z: float, wide: float) -> None:
    """Hang a piece of laundry over a rail along x: both halves fall down."""
    across = np.linspace(-0.5, 0.5, 12)[None] * wide + rng.normal(0, 0.1)
    down = np.linspace(-1, 1, 13)[:, None]
    long = rng.uniform(0.2, min(0.8, top - 0.05))
    folds = 0.02 * np.abs(down) * np.sin(across * rng.uniform(10, 40) + rng.uniform(0, 6))
    y = top + 0.01 - long * np.abs(down) * (0.95 + 0 * across)
    spread = z + np.sign(down) * 0.03 * np.sqrt(np.abs(down)) + folds
    albedo = sample_dark(rng) if rng.random() < 0.3 else random_albedo(rng)
    thing.sheet(np.stack([np.broadcast_to(across, y.shape), y, spread], axis=-1), albedo=albedo)
