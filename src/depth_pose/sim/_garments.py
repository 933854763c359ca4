"""Loose garments: skirts, coats, cloaks, scarves, long hair.

They are shaped from the posed body directly, without simulating cloth: a skirt's rows are ellipses
across both legs, a cloak is the body's silhouette around a vertical axis, hanging from the last point
of contact.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, uniform_filter

from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX
from depth_pose.sim._meshes import Piece, loft

Array = NDArray[np.float64]

_SKIRT_COLUMNS, _SKIRT_ROWS = 28, 9
"""Points of a skirt around and down."""
_CLOAK_COLUMNS, _CLOAK_ROW_M = 28, 0.06
"""Points of a cloak around, and the height of its rows, metres on the 1.75 m body."""


@dataclass(frozen=True)
class Wearer:
    """The posed person who wears the garments.

    Attributes
    ----------
    vertices : (V, 3) float64
        Dressed skin, metres, y up.
    nodes : (21, 3) float64
    rotations : (21, 3, 3) float64
    weights : (V, 21) float64
        Skin weights.
    stature : float
    floor : float
        Height of the person's support, metres.
    """

    vertices: Array
    nodes: Array
    rotations: Array
    weights: Array
    stature: float
    floor: float

    @property
    def size(self) -> float:
        """Size relative to the 1.75 m adult."""
        return self.stature / ADULT_STATURE_M

    def node(self, name: str) -> Array:
        """Position of a node, metres."""
        return self.nodes[NODE_INDEX[name]]

    def part(self, *names: str) -> Array:
        """Vertices that these nodes move most, (n, 3)."""
        columns = [NODE_INDEX[n] for n in names]
        return self.vertices[self.weights[:, columns].sum(axis=1) > 0.5]


def skirt(rng: np.random.Generator, wearer: Wearer, reach: float, flare: float, opened: bool) -> Piece:
    """Make a skirt, or the lower part of a coat or dress.

    Parameters
    ----------
    rng : numpy.random.Generator
        Of the folds.
    wearer : Wearer
    reach : float
        Length along the leg: 0.5 ends at the knee, 1 at the ankle.
    flare : float
        Extra width of the hem over the legs, metres on the 1.75 m body.
    opened : bool
        Whether the front is open, as a coat's.
    """
    pelvis, size = wearer.rotations[0], wearer.size
    down = np.linspace(0.0, reach, _SKIRT_ROWS)
    left, right = (_along_leg(wearer, side, down) for side in ("left", "right"))
    centre = 0.5 * (left + right)
    angle = 2 * np.pi * np.arange(_SKIRT_COLUMNS) / _SKIRT_COLUMNS
    folds = rng.uniform(0.0, 0.03) * np.sin(rng.integers(5, 11) * angle + rng.uniform(0, 6.28))
    waist = wearer.part("pelvis", "spine")
    local = (waist - wearer.nodes[0]) @ pelvis
    local = local[np.abs(local[:, 1] - 0.06 * size) < 0.06 * size]
    wide, deep = np.abs(local[:, [0, 2]]).max(axis=0) if len(local) else (0.16 * size, 0.12 * size)
    rings = np.empty((_SKIRT_ROWS + 1, _SKIRT_COLUMNS, 3))
    top = wearer.nodes[0] + pelvis @ [0.0, 0.08 * size, 0.0]
    rings[0] = _ellipse(top, pelvis, wide + 0.01, deep + 0.01, angle)
    tangent = np.gradient(centre, axis=0)
    for i, s in enumerate(down):
        axes = _cross_axes(tangent[i], pelvis[:, 0])
        apart = 0.5 * (left[i] - right[i])
        radius = (0.105 - 0.045 * s) * size
        share = max(1.0 - 3.0 * s, 0.0)
        a = max(abs(apart @ axes[:, 0]) + radius, share * (wide + 0.015)) + size * flare * s
        b = max(abs(apart @ axes[:, 2]) + radius, share * (deep + 0.015)) + size * flare * s
        rings[i + 1] = _ellipse(centre[i], axes, a + size * s * folds, b + size * s * folds, angle)
    rings[..., 1] = np.maximum(rings[..., 1], wearer.floor + 0.004)
    if opened:
        gap = rng.integers(1, 5)
        columns = np.arange(gap, _SKIRT_COLUMNS - gap + 1)
        return loft(rings[:, columns], closed=False)
    return loft(rings)


def _ellipse(centre: Array, axes: Array, a: Array | float, b: Array | float, angle: Array) -> Array:
    sine, cosine = (a * np.sin(angle))[:, None], (b * np.cos(angle))[:, None]
    return np.asarray(centre + sine * axes[:, 0] + cosine * axes[:, 2])


def _cross_axes(tangent: Array, left: Array) -> Array:
    """Axes with y against a leg's direction and x as far to the left as can be, (3, 3)."""
    y = -tangent / max(float(np.linalg.norm(tangent)), 1e-9)
    x = left - (left @ y) * y
    x = x / max(float(np.linalg.norm(x)), 1e-9)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _along_leg(wearer: Wearer, side: str, share: Array) -> Array:
    hip, knee, ankle = (wearer.node(f"{side}_{n}") for n in ("hip", "knee", "ankle"))
    upper = np.minimum(share, 0.5)[:, None] * 2.0
    lower = np.maximum(share - 0.5, 0.0)[:, None] * 2.0
    return np.asarray(hip + upper * (knee - hip) + lower * (ankle - knee))


def cloak(rng: np.random.Generator, wearer: Wearer, drop: float, opened: bool) -> Piece:
    """Make a cloak, poncho or blanket round the shoulders of someone upright.

    Parameters
    ----------
    rng : numpy.random.Generator
    wearer : Wearer
    drop : float
        Length below the neck, metres on the 1.75 m body.
    opened : bool
        Whether it is open in front.
    """
    size = wearer.size
    top = float(wearer.node("neck")[1]) + 0.03 * size
    rows = max(4, round(drop / _CLOAK_ROW_M))
    step = _CLOAK_ROW_M * size
    head = wearer.weights[:, NODE_INDEX["head"]] > 0.3
    points = wearer.vertices[~head]
    neck, pelvis = wearer.node("neck"), wearer.nodes[0]
    share = np.clip((neck[1] - points[:, 1]) / max(neck[1] - pelvis[1], 0.05), 0, 1)[:, None]
    away = points[:, [0, 2]] - (neck + share * (pelvis - neck))[:, [0, 2]]
    row = np.floor((top - points[:, 1]) / step).astype(int)
    column = np.floor(np.arctan2(away[:, 0], away[:, 1]) / (2 * np.pi) * _CLOAK_COLUMNS).astype(int)
    inside = (row >= 0) & (row < rows)
    radius = np.zeros((rows, _CLOAK_COLUMNS))
    far = np.minimum(np.linalg.norm(away, axis=1), 0.48 * size)
    np.maximum.at(radius, (row[inside], column[inside] % _CLOAK_COLUMNS), far[inside])
    radius[0] = np.maximum(radius[0], 0.07 * size)
    radius = maximum_filter(radius, (1, 5), mode=("nearest", "wrap"))
    for i in range(1, rows):
        radius[i] = np.maximum(radius[i], radius[i - 1] * 0.985)
    radius = uniform_filter(radius, (1, 5), mode=("nearest", "wrap")) + rng.uniform(0.01, 0.03) * size
    angle = 2 * np.pi * (np.arange(_CLOAK_COLUMNS) + 0.5) / _CLOAK_COLUMNS
    deep = np.linspace(0, 1, rows)[:, None]
    folds = np.sin(rng.integers(4, 9) * angle + rng.uniform(0, 6.28))
    radius = radius + size * deep * (rng.uniform(0.0, 0.03) * folds + rng.uniform(0.0, 0.06))
    y = top - step * (np.arange(rows) + 0.5)
    share = np.clip((neck[1] - y) / max(neck[1] - pelvis[1], 0.05), 0, 1)[:, None]
    axis = neck + share * (pelvis - neck)
    rings = np.empty((rows, _CLOAK_COLUMNS, 3))
    rings[..., 0] = axis[:, :1] + radius * np.sin(angle)
    rings[..., 2] = axis[:, 2:] + radius * np.cos(angle)
    rings[..., 1] = np.maximum(y, wearer.floor + 0.004)[:, None]
    if opened:
        gap = rng.integers(1, 4)
        return loft(rings[:, gap : _CLOAK_COLUMNS - gap], closed=False)
    return loft(rings)


def scarf(rng: np.random.Generator, wearer: Wearer) -> Piece:
    """Make a scarf or thick collar round the neck."""
    size = wearer.size
    neck, axes = wearer.node("neck"), wearer.rotations[NODE_INDEX["neck"]]
    angle = 2 * np.pi * np.arange(16) / 16
    tube = 2 * np.pi * np.arange(8) / 8
    thick = rng.uniform(0.025, 0.045) * size
    radius = 0.065 * size + thick * (1.0 + 0.7 * np.cos(tube))[:, None] + 0 * angle
    lift = (0.02 * size + 1.3 * thick * np.sin(tube))[:, None] + 0.3 * thick * np.sin(
        2 * angle + rng.uniform(0, 6)
    )
    local = np.stack([radius * np.sin(angle), lift, radius * np.cos(angle)], axis=-1)
    rings = neck + local @ axes.T
    return loft(np.concatenate([rings, rings[:1]]))


def hanging_hair(rng: np.random.Generator, wearer: Wearer, length: float) -> Piece:
    """Make hair that falls from the back of the head, over the neck and back.

    Parameters
    ----------
    rng : numpy.random.Generator
    wearer : Wearer
    length : float
        Below the ears, metres on the 1.75 m body.
    """
    middle, axes, half = head_box(wearer)
    chest, size = wearer.rotations[NODE_INDEX["chest"]], wearer.size
    half_arc = np.radians(rng.uniform(55, 110))
    angle = np.pi + np.linspace(-half_arc, half_arc, 15)
    down = np.linspace(0.0, 1.0, 8)[:, None]
    # It starts at the height of the ears, falls by its weight and lies on the neck and back.
    fall = 0.55 * np.array([0.0, -1.0, 0.0]) - 0.45 * axes[:, 1]
    fall = fall - 0.35 * np.maximum(fall @ chest[:, 2], 0.0) * chest[:, 2]
    fall = fall / max(float(np.linalg.norm(fall)), 0.3)
    narrow = (1.03 - rng.uniform(0.10, 0.30) * np.minimum(2.0 * down, 1.0)) * (1.0 + 0.25 * down)
    strands = 1.0 + rng.uniform(0.0, 0.10) * down * np.sin(rng.uniform(4, 9) * angle + rng.uniform(0, 6.28))
    ring = np.stack(
        [
            half[0] * narrow * strands * np.sin(angle),
            np.full((len(down), len(angle)), 0.2 * half[1]),
            half[2] * narrow * strands * np.cos(angle) * (1.0 - 0.35 * down),
        ],
        axis=-1,
    )
    rings = middle + ring @ axes.T + (down * size * length)[..., None] * fall
    rings[..., 1] = np.maximum(rings[..., 1], wearer.floor + 0.004)
    return loft(rings, closed=False)


def _middle(local: Array) -> tuple[Array, Array]:
    """Middle and half extents of points."""
    low, high = local.min(axis=0), local.max(axis=0)
    return (low + high) / 2, (high - low) / 2


def head_box(wearer: Wearer) -> tuple[Array, Array, Array]:
    """Middle of the head (3,), its axes (3, 3) and half extents (3,), with hair, metres."""
    axes = wearer.rotations[NODE_INDEX["head"]]
    middle, half = _middle((wearer.part("head") - wearer.node("head")) @ axes)
    return wearer.node("head") + axes @ middle, axes, half
