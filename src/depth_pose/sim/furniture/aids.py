"""Aids of people who walk or sit with difficulty: wheelchairs, walking frames, crutches, sticks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.sim.shapes import Assembly, Kind, random_albedo

Array = NDArray[np.float64]

_SPOKES, _RIM_POINTS = 7, 24
"""Spokes and rim points of a wheelchair's large wheels."""


def make_wheelchair(
    rng: np.random.Generator, seat: float | None = None, back: float | None = None, tilt: float = 0.12
) -> Assembly:
    """Make a wheelchair that faces +z.

    Parameters
    ----------
    rng : numpy.random.Generator
    seat : float, optional
        Height of the seat, metres.
    back : float, optional
        Where the backrest meets the seat, z, metres.
    tilt : float
        Of the backrest, backward, radians.
    """
    thing = Assembly(Kind.AID, random_albedo(rng, 0.5))
    high = rng.uniform(0.46, 0.53) if seat is None else seat
    rear = -0.22 if back is None else back
    half, deep = rng.uniform(0.21, 0.27), rng.uniform(0.38, 0.45)
    tall = rng.uniform(0.32, 0.55)
    front = rear + deep
    lean = np.array([0.0, np.cos(tilt), -np.sin(tilt)])
    foot = np.array([0.0, high, rear])
    thing.box((0, high - 0.015, rear + deep / 2), (2 * half, 0.03, deep))
    thing.box(foot + (0.5 * tall + 0.05) * lean - [0, 0, 0.01], (2 * half, tall, 0.02), 0.0, -tilt)
    radius = rng.uniform(0.28, 0.32)
    grip = tall + rng.uniform(0.05, 0.12)
    for side in (-1, 1):
        x = side * (half + 0.015)
        beside, pole = np.array([x, 0.0, 0.0]), foot + [x, 0.0, 0.0]
        thing.bar(pole, pole + grip * lean, 0.012)
        thing.bar(pole + grip * lean, pole + grip * lean - [0, 0, 0.11], 0.016)
        thing.bar(beside + [0, high, rear], beside + [0, high, front], 0.012)
        thing.bar(beside + [0, high, front], beside + [0, 0.12, front + 0.14], 0.012)
        thing.box((side * 0.6 * half, 0.11, front + 0.2), (0.8 * half, 0.015, 0.15), 0.0, 0.25)
        if rng.random() < 0.8:
            thing.box((x, high + 0.22, rear + 0.45 * deep), (0.05, 0.03, 0.7 * deep))
            thing.box((x, high + 0.11, rear + 0.4 * deep), (0.01, 0.2, 0.6 * deep))
        _add_wheel(thing, side * (half + 0.06), radius, rear + 0.06)
        thing.bar((x - 0.015, 0.09, front + 0.0), (x + 0.015, 0.09, front + 0.0), 0.09)
    return thing


def _add_wheel(thing: Assembly, x: float, radius: float, z: float) -> None:
    """Add a wheel with spokes and a hand rim in the plane of `x`."""
    around = np.linspace(0, 2 * np.pi, _RIM_POINTS)
    for out, aside, wide in ((radius, 0.0, 0.03), (0.9 * radius, 0.03 * np.sign(x), 0.015)):
        rows = [(out - wide, -wide / 2), (out, -wide / 2), (out, wide / 2), (out - wide, wide / 2)]
        rings = [
            np.stack(
                [0 * around + x + aside + a, radius + r * np.sin(around), z + r * np.cos(around)], axis=-1
            )
            for r, a in rows
        ]
        thing.sheet(np.array(rings))
    for angle in around[:: _RIM_POINTS // _SPOKES]:
        end = (x, radius + 0.95 * radius * np.sin(angle), z + 0.95 * radius * np.cos(angle))
        thing.bar((x, radius, z), end, 0.006)


def make_walker(rng: np.random.Generator, grips: Array | None = None) -> Assembly:
    """Make a walking frame or a rollator before somebody at the origin.

    Parameters
    ----------
    rng : numpy.random.Generator
    grips : (2, 3) array, optional
        Where the left and the right hand hold it, metres.
    """
    thing = Assembly(Kind.AID, random_albedo(rng, 0.2))
    if grips is None:
        y, z = rng.uniform(0.78, 0.95), rng.uniform(0.2, 0.4)
        grips = np.array([[0.25, y, z], [-0.25, y, z]])
    thick, rollator = rng.uniform(0.011, 0.018), rng.random() < 0.5
    ahead = np.array([0.0, 0.0, rng.uniform(0.25, 0.4)])
    rail = []
    for grip in grips:
        side = 1.0 if grip[0] > grips[:, 0].mean() else -1.0
        out = np.array([0.04 * side, 0.0, 0.0])
        low = grip * [1, 0, 1] + out
        thing.bar(grip - [0, 0, 0.08], grip + [0, 0, 0.06], 0.018)
        thing.bar(grip, low + [0, 0.03, -0.1 if not rollator else -0.16], thick)
        thing.bar(grip + [0, 0, 0.04], low + ahead + [0, 0.03, 0], thick)
        rail.append(grip + 0.5 * (low + ahead - grip))
        if rollator:
            for wheel in (low - [0, 0, 0.16], low + ahead):
                thing.bar(wheel + [-0.015, 0.09, 0], wheel + [0.015, 0.09, 0], 0.09)
    thing.bar(rail[0], rail[1], thick)
    if rollator:
        middle = np.mean(rail, axis=0)
        wide = abs(float(rail[0][0] - rail[1][0]))
        thing.box(middle + [0, 0.05, -0.1], (wide, 0.02, 0.22))
        if rng.random() < 0.5:
            thing.box(middle + [0, -0.05, 0.12], (0.8 * wide, 0.22, 0.2))
    else:
        thing.bar(rail[0] - [0, 0.25, 0], rail[1] - [0, 0.25, 0], thick)
    return thing


def make_crutch(rng: np.random.Generator, hand: Array, elbow: Array, shoulder: Array) -> Assembly:
    """Make a crutch or stick under a hand: to the forearm, to the armpit, or ending there."""
    thing = Assembly(Kind.AID, random_albedo(rng, 0.15))
    foot = hand * [1, 0, 1] + [0.08 * np.sign(hand[0]), 0.0, rng.uniform(-0.05, 0.15)]
    thick, what = rng.uniform(0.01, 0.016), rng.integers(0, 3)
    thing.bar(foot, foot + [0, 0.04, 0], thick + 0.012)
    thing.bar(foot, hand, thick)
    thing.bar(hand - [0, 0, 0.06], hand + [0, 0, 0.06], 0.017)
    if what == 0:
        cuff = elbow + 0.35 * (hand - elbow) + [0.03 * np.sign(hand[0]), 0, -0.03]
        thing.bar(hand, cuff, thick)
        thing.bar(cuff - [0, 0.03, 0], cuff + [0, 0.03, 0], 0.05)
    elif what == 1:
        pit = shoulder - [0, 0.12, 0]
        thing.bar(hand, pit, thick)
        thing.bar(pit - [0, 0, 0.1], pit + [0, 0, 0.1], 0.025)
    return thing
