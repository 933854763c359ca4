"""Settle a posed body on floor, bed or seat.

A body that lies, kneels, crawls or sits on the floor rests on at least two places, as a rigid body does on
the edge of its lower hull under its centre of mass. It is tilted until that edge is level, then lowered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from depth_pose.core.rotations import rotation_x
from depth_pose.sim._builds import Build

Array = NDArray[np.float64]

TOUCHING, DEEPEST_SINK_M = 0.04, 0.03
"""Share of a lying body's surface in contact with its support, and maximum depth that it sinks in, metres."""

MOST_TILT_DEG = 12.0
"""Maximum tilt: postures are made nearly level; more than this would be another posture."""

_LEVELLED = ("lie", "crawl", "kneel")


@dataclass(frozen=True)
class Rested:
    """A body at rest, pelvis above the origin.

    Attributes
    ----------
    skin : (V, 3) float64
        Metres, y up from the floor.
    nodes : (21, 3) float64
    rotations : (21, 3, 3) float64
    seat : float
        Height of the seat or bed, metres; 0 for the floor.
    """

    skin: Array
    nodes: Array
    rotations: Array
    seat: float


def put_down(
    rng: np.random.Generator,
    body: tuple[Array, Array, Array],
    build: Build,
    posture: str,
    raised: bool,
) -> Rested:
    """Settle a posed body on its support.

    Parameters
    ----------
    rng : numpy.random.Generator
        Random numbers for the bed's height.
    body : (skin, nodes, rotations)
        Posed with the pelvis at the origin.
    build : Build
    posture : str
    raised : bool
        Whether the posture needs a seat.
    """
    skin, nodes, rotations = body
    if posture in _LEVELLED or (posture == "sit" and not raised):
        limit = np.radians(MOST_TILT_DEG)
        tilt = rotation_x(np.clip(-_support_slope(skin), -limit, limit))
        skin, nodes, rotations = skin @ tilt.T, nodes @ tilt.T, tilt @ rotations
    seat, rise = _heights(rng, skin, build, posture, raised)
    up = np.array([0.0, rise, 0.0])
    return Rested(skin + up, nodes + up, rotations, seat)


def _support_slope(skin: Array) -> float:
    """Angle by which the supporting edge turns about x from level, radians."""
    points = skin[:, [2, 1]]
    hull = points[ConvexHull(points).vertices]
    ahead = np.roll(hull, -1, axis=0)
    # Counter-clockwise with z to the right and y up: the lower edges run toward +z.
    middle = float(points[:, 0].mean())
    under = np.flatnonzero((hull[:, 0] <= middle) & (middle < ahead[:, 0]))
    edge = ahead[under[0]] - hull[under[0]]
    return float(-np.arctan2(edge[1], edge[0]))


def _heights(
    rng: np.random.Generator, skin: Array, build: Build, posture: str, raised: bool
) -> tuple[float, float]:
    """Return the height of the seat or bed, and the height of the pelvis above the floor."""
    lowest = float(skin[:, 1].min())
    if posture == "lie":
        # Beds and sofas are 0.35 to 0.65 m high.
        bed = float(rng.uniform(0.35, 0.65)) if rng.uniform() < 0.55 else 0.0
        flat = float(np.quantile(skin[:, 1], TOUCHING))
        return bed, bed - min(flat, lowest + DEEPEST_SINK_M)
    bottom = build.body.weights[:, 0] > 0.5
    if posture == "sit" and not raised:
        return 0.0, -min(float(skin[bottom, 1].min()), lowest + DEEPEST_SINK_M)
    if raised:
        seat = float(skin[bottom, 1].min())
        # Feet of small people hang when the chair is high.
        hanging = float(rng.uniform(0.0, 0.2)) if build.body.stature < 1.4 and rng.uniform() < 0.5 else 0.0
        return seat - lowest + hanging, hanging - lowest
    return 0.0, -lowest
