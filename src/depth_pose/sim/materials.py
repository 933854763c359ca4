"""Infrared reflectance of what people wear and of what stands in homes.

Sensors with their own light (structured light, time of flight) lose a surface where the light that returns,
reflectance times cos(angle)^p / distance^2, is below a limit of the sensor (`depth_pose.sim.scene_noise`). So
one number per material gives the share of holes by sensor, angle and distance: black cloth, leather and dark
hair reflect some thousandths and are holes nearly everywhere, denim returns in blotches at 2 m and nothing at
4 m, light cloth returns everywhere. Ranges are set by hand beside recordings of people in dark clothes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

REFLECTANCE: dict[str, tuple[float, float]] = {
    "cloth": (0.25, 0.9),
    "dark cloth": (0.02, 0.1),
    "denim": (0.005, 0.03),
    "black cloth": (0.0006, 0.008),
    "leather": (0.0005, 0.004),
    "dark hair": (0.0006, 0.01),
    "brown hair": (0.01, 0.06),
    "fair hair": (0.15, 0.5),
    "screen": (0.0003, 0.002),
    "glass": (0.0002, 0.003),
}
"""Range of the reflectance of each material near 850 nm; sampled evenly in its logarithm."""

WORN: dict[str, dict[str, float]] = {
    "hair": {"dark hair": 0.4, "brown hair": 0.25, "fair hair": 0.35},
    "top": {"cloth": 0.6, "dark cloth": 0.12, "denim": 0.06, "black cloth": 0.15, "leather": 0.07},
    "trousers": {"cloth": 0.4, "dark cloth": 0.13, "denim": 0.2, "black cloth": 0.2, "leather": 0.07},
    "shoes": {"cloth": 0.5, "black cloth": 0.2, "leather": 0.3},
}
"""Shares of the materials of each part of what people wear."""


@dataclass(frozen=True)
class Wardrobe:
    """Materials of a person's parts, in the order of `WORN`, and their reflectances.

    Attributes
    ----------
    names : tuple of str
        Keys of `REFLECTANCE`.
    albedos : tuple of float
    """

    names: tuple[str, ...]
    albedos: tuple[float, ...]


def sample_reflectance(rng: np.random.Generator, material: str) -> float:
    """Sample the reflectance of one piece of a material."""
    low, high = REFLECTANCE[material]
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sample_wardrobe(rng: np.random.Generator) -> Wardrobe:
    """Sample the materials of one person's hair and clothes."""
    names = tuple(str(rng.choice(list(w), p=list(w.values()))) for w in WORN.values())
    return Wardrobe(names, tuple(sample_reflectance(rng, name) for name in names))


def sample_dark(rng: np.random.Generator) -> float:
    """Sample the reflectance of a sofa, carpet, blanket or case that returns little light."""
    return sample_reflectance(rng, str(rng.choice(["black cloth", "leather", "denim"])))
