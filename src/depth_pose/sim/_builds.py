"""Builds of simulated people: children to tall adults, thin to very heavy.

Statures of adults are normal about the means of NCD Risk Factor Collaboration, *A century of
trends in adult human height*, eLife 5, 2016 (rounded: 1.76 m and 1.63 m in high-income countries,
standard deviation 0.07 m). Body mass indices are log-normal, about 25 kg/m2. A head grows with
about the 0.38th power of stature (the fraction of a child's head is larger).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from depth_pose.body.body import Body
from depth_pose.body.procedural import BodyShape, make_body

POOL = 320
"""Maximum number of builds per process; each costs some 7 ms, once."""

CHILDREN = 0.2
"""Share of children."""

_AVERAGE_BMI = 23.0
"""Body mass index of the average build, kg/m^2. Set by hand."""
_POOL_SEED = 4711
"""Seed of the builds; any would do."""


@dataclass(frozen=True)
class Build:
    """A body, and attributes that its shape factors do not define.

    Attributes
    ----------
    body : Body
    heaviness : float
        Logarithm of the body mass index against the average build's.
    woman : bool
    """

    body: Body
    heaviness: float
    woman: bool


def draw_build(rng: np.random.Generator, tallest: float = np.inf) -> Build:
    """Pick a build, no taller than some metres, from this process's pool: the same in every process."""
    while True:
        build = _build(int(rng.integers(POOL)))
        if build.body.stature <= tallest:
            return build


@lru_cache(maxsize=POOL)
def _build(index: int) -> Build:
    rng = np.random.default_rng([_POOL_SEED, index])
    child, woman = rng.uniform() < CHILDREN, bool(rng.uniform() < 0.5)
    if child:
        stature = rng.uniform(1.0, 1.55)
        heaviness = float(np.clip(rng.normal(0.0, 0.14), -0.2, 0.45))
    else:
        stature = float(np.clip(rng.normal(1.63 if woman else 1.76, 0.075), 1.45, 2.0))
        heaviness = float(np.clip(rng.normal(np.log(25.5 / _AVERAGE_BMI), 0.19), -0.3, 0.65))
    shape = _shape(rng, float(stature), heaviness, child, woman)
    return Build(make_body(shape), heaviness, woman and not child)


def _shape(rng: np.random.Generator, stature: float, heaviness: float, child: bool, woman: bool) -> BodyShape:
    """Sample proportions for a stature, a weight, an age and a sex."""

    def vary(mean: float, spread: float) -> float:
        return float(np.clip(mean + spread * rng.normal(), 0.55, 1.95))

    # Mass over height squared goes with the breadth times the depth of the body.
    heavy = float(np.exp(0.42 * heaviness))
    hips, shoulders = (1.06, 0.94) if woman else (0.98, 1.03)
    if child:
        hips, shoulders = 0.98, 0.97
    size = 1.75 / stature
    return BodyShape(
        stature_m=stature,
        girth=vary(heavy * (1.04 if child else 1.0), 0.045),
        shoulder_width=vary(shoulders * heavy**-0.25, 0.035),
        hip_width=vary(hips * heavy**-0.1, 0.04),
        leg_length=vary(1.0 - (0.12 * (size - 1.15) if child else 0.0), 0.03),
        arm_length=vary(1.0, 0.03),
        trunk_length=vary(1.0, 0.03),
        head_size=vary(size**0.62, 0.035),
        trunk_depth=vary(float(np.exp(0.45 * heaviness)), 0.06),
    )
