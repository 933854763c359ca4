"""Tight clothes, hair and belly: the body's surface moved outward.

Thickness is drawn per region and varied smoothly over the surface; folds are shorter waves. Cloth
on the underside of a limb hangs further off it. Hands and face stay bare.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.normals import normals_of
from depth_pose.core.skeleton import ADULT_STATURE_M, NODES
from depth_pose.sim._builds import Build
from depth_pose.sim._meshes import smooth_noise

Array = NDArray[np.float64]

REGIONS = ("trunk", "neck", "head", "upper_arms", "forearms", "hands", "thighs", "shanks", "feet")
THICKEST_M = 0.06
"""Maximum distance of cloth from the skin: the value that closed the gap to real depth images in a trial."""

_REGION_OF = {
    "pelvis": "trunk", "spine": "trunk", "chest": "trunk", "clavicle": "trunk", "neck": "neck",
    "head": "head", "shoulder": "upper_arms", "elbow": "forearms", "wrist": "hands",
    "hip": "thighs", "knee": "shanks", "ankle": "feet", "foot": "feet",
}  # fmt: skip


@dataclass(frozen=True)
class Surface:
    """Attributes of a template's surface that clothes need.

    Attributes
    ----------
    regions : (V, 9) float64
        Share of each of `REGIONS` in a vertex.
    rest : (V, 3) float64
        Template, metres: where noise and bumps are placed.
    skull : (V,) float64
        1 where hair grows, 0 on the face and elsewhere.
    belly, chest : (V,) float64
        Bumps of height 1 there.
    """

    regions: Array
    rest: Array
    skull: Array
    belly: Array
    chest: Array


@lru_cache(maxsize=4)
def surface_of(body: Body) -> Surface:
    """Regions of a family's average body, whose mesh all its builds share."""
    regions = np.zeros((len(body.vertices), len(REGIONS)))
    for i, name in enumerate(NODES):
        bare = name.removeprefix("left_").removeprefix("right_")
        regions[:, REGIONS.index(_REGION_OF[bare])] += body.weights[:, i]
    head = regions[:, REGIONS.index("head")]
    at = body.vertices[head > 0.6]
    low, high = at.min(axis=0), at.max(axis=0)
    place = (body.vertices - (low + high) / 2) / ((high - low) / 2)
    hair = 0.75 * place[:, 1] - 0.85 * place[:, 2]
    skull = np.clip((hair - 0.05) / 0.35, 0, 1) * np.clip(2 * head - 0.5, 0, 1)
    belly = _bump(body.vertices, *_BELLY)
    chest = _bump(body.vertices, *_CHEST) + _bump(body.vertices * [-1, 1, 1], *_CHEST)
    return Surface(regions, body.vertices, skull, belly, chest)


_BELLY = (np.array([0.0, 1.02, 0.13]), 0.11)
"""Middle and width of the belly's bump on the 1.75 m body, metres."""
_CHEST = (np.array([0.085, 1.27, 0.11]), 0.055)
"""The same for the left side of a chest; the right one is its mirror image."""


def _bump(points: Array, centre: Array, width: float) -> Array:
    return np.asarray(np.exp(-0.5 * ((points - centre) ** 2).sum(axis=1) / width**2))


@dataclass(frozen=True)
class Cut:
    """Thickness of the clothes, metres on the 1.75 m body, and bumps under them.

    Attributes
    ----------
    thickness : (9,) float64
        By `REGIONS`.
    hair : float
        Thickness of hair or hat on the skull.
    belly, chest : float
        Height of a bump there.
    sag : float
        Extra distance of cloth from undersides, as a factor on its thickness.
    """

    thickness: Array
    hair: float
    belly: float
    chest: float
    sag: float


def draw_cut(rng: np.random.Generator, build: Build) -> Cut:
    """Draw a top, trousers, shoes and hair."""
    # Skin or sport, shirt, pullover, coat.
    top = rng.choice(4, p=[0.10, 0.36, 0.32, 0.22])
    low, high = ((0.0, 0.006), (0.006, 0.020), (0.015, 0.035), (0.030, 0.055))[top]
    trunk = rng.uniform(low, high)
    legs = (
        rng.uniform(0.002, 0.010) if rng.uniform() < 0.3 else rng.uniform(0.008, 0.030 if top < 3 else 0.045)
    )
    bare_arms = rng.uniform() < (0.5 if top < 2 else 0.08)
    sleeve = trunk * rng.uniform(0.5, 0.9)
    hood = top >= 2 and rng.uniform() < 0.18
    thickness = {
        "trunk": trunk,
        "neck": 0.03 if hood else trunk * rng.uniform(0.0, 0.5),
        "head": 0.0,
        "upper_arms": sleeve,
        "forearms": 0.0 if bare_arms else sleeve * rng.uniform(0.5, 0.9),
        "hands": 0.0,
        "thighs": legs,
        "shanks": 0.0 if rng.uniform() < 0.12 else legs * rng.uniform(0.6, 1.4),
        "feet": rng.uniform(0.0, 0.020),
    }
    hair = rng.choice(4, p=[0.12, 0.45, 0.33, 0.10])
    thick = rng.uniform(*((0.0, 0.004), (0.005, 0.02), (0.015, 0.035), (0.03, 0.07))[hair])
    belly = max(0.0, build.heaviness) * rng.uniform(0.05, 0.22) + (0.09 if rng.uniform() < 0.02 else 0.0)
    return Cut(
        np.array([thickness[name] for name in REGIONS]),
        float(rng.uniform(0.035, 0.055) if hood else thick),
        float(belly),
        float(rng.uniform(0.0, 0.045) if build.woman else 0.0),
        float(rng.uniform(0.0, 1.2)),
    )


def dress(rng: np.random.Generator, vertices: Array, build: Build, cut: Cut) -> Array:
    """Push a posed body's skin out to its clothes.

    Parameters
    ----------
    rng : numpy.random.Generator
        Of the folds.
    vertices : (V, 3)
        Posed, metres, y up.
    build : Build
    cut : Cut

    Returns
    -------
    (V, 3) float64
    """
    surface, size = surface_of(build.template), build.body.stature / ADULT_STATURE_M
    normals = normals_of(vertices, build.body.faces, by_face=True)
    wide = smooth_noise(rng, surface.rest, (0.25, 0.7), 8)
    folds = smooth_noise(rng, surface.rest, (0.06, 0.18), 10)
    out = surface.regions @ cut.thickness
    limbs = surface.regions[:, [0, 3, 4, 6, 7]].sum(axis=1)
    hanging = 1.0 + cut.sag * limbs * np.maximum(-normals[:, 1], 0.0)
    out = np.clip(out * (1.0 + 0.5 * wide + 0.35 * folds) * hanging, 0.0, THICKEST_M)
    out += surface.skull * cut.hair * (1.0 + 0.25 * wide)
    out += cut.belly * surface.belly + cut.chest * surface.chest
    return np.asarray(vertices + size * out[:, None] * normals)
