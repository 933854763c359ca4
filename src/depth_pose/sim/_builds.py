"""Builds of simulated people: children to tall adults, thin to very heavy.

Statures of adults are normal about the means of NCD Risk Factor Collaboration, *A century of
trends in adult human height*, eLife 5, 2016 (rounded: 1.76 m and 1.63 m in high-income countries,
standard deviation 0.07 m). Body mass indices are log-normal, about 25 kg/m2. A head grows with
about the 0.38th power of stature (the fraction of a child's head is larger).

There are two families of bodies: the embedded one, and with the extra ``anny`` the shapes of Anny, whose
proportions, muscles and fat come from its phenotypes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from depth_pose.body.body import Body
from depth_pose.body.procedural import BodyShape, make_body

POOL, ANNY_POOL = 320, 1500
"""Maximum number of builds per process and family; each costs some 7 or 30 ms, once."""

CHILDREN = 0.2
"""Share of children."""

_AVERAGE_BMI = 23.0
"""Body mass index of the average build, kg/m^2."""
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
    template : Body
        Average body of the family: the same faces, 1.75 m.
    """

    body: Body
    heaviness: float
    woman: bool
    template: Body


def draw_build(
    rng: np.random.Generator, tallest: float = np.inf, anny: float = 0.0, is_new: bool = False
) -> Build:
    """Pick a build from this process's pools, which are the same in every process, or sample a new one.

    Parameters
    ----------
    rng : numpy.random.Generator
    tallest : float
        Maximum stature, metres.
    anny : float
        Share of bodies of Anny.
    is_new : bool
        Sample a build that nobody else has. A new one of Anny lies between two of the pool.
    """
    while True:
        of_anny = anny > 0.0 and rng.random() < anny
        if is_new:
            build = _between_two(rng) if of_anny else _sample_build(rng)
        elif of_anny:
            build = _anny_build(int(rng.integers(ANNY_POOL)))
        else:
            build = _build(int(rng.integers(POOL)))
        if build.body.stature <= tallest:
            return build


@lru_cache(maxsize=POOL)
def _build(index: int) -> Build:
    return _sample_build(np.random.default_rng([_POOL_SEED, index]))


def _sample_build(rng: np.random.Generator) -> Build:
    """Sample a build of the embedded body."""
    child, woman = rng.uniform() < CHILDREN, bool(rng.uniform() < 0.5)
    stature, heaviness = _size(rng, child, woman)
    shape = _shape(rng, stature, heaviness, child, woman)
    return Build(make_body(shape), heaviness, woman and not child, make_body())


def _between_two(rng: np.random.Generator) -> Build:
    """Interpolate between two builds of Anny, at a random share of the way."""
    a, b = (_anny_build(int(i)) for i in rng.integers(ANNY_POOL, size=2))
    share = float(rng.uniform())
    body = replace(
        a.body,
        vertices=a.body.vertices + share * (b.body.vertices - a.body.vertices),
        nodes=a.body.nodes + share * (b.body.nodes - a.body.nodes),
        stature=a.body.stature + share * (b.body.stature - a.body.stature),
    )
    heaviness = a.heaviness + share * (b.heaviness - a.heaviness)
    return Build(body, heaviness, a.woman if share < 0.5 else b.woman, a.template)


@lru_cache(maxsize=ANNY_POOL)
def _anny_build(index: int) -> Build:
    """Sample one of Anny's phenotypes; muscles, fat and proportions vary evenly over their whole range."""
    from depth_pose.body.anny_body import AnnyShape, make_anny_body

    rng = np.random.default_rng([_POOL_SEED, 1, index])
    child, woman = rng.uniform() < CHILDREN, bool(rng.uniform() < 0.5)
    stature, heaviness = _size(rng, child, woman)
    shape = AnnyShape(
        gender=float(np.clip((1.0 if woman else 0.0) + rng.normal(0.0, 0.15), 0.0, 1.0)),
        age=float(np.interp(stature, (1.0, 1.55), (0.28, 0.5)) if child else rng.uniform(0.6, 1.0)),
        muscle=float(rng.uniform()),
        weight=float(np.clip(0.5 + 0.9 * heaviness + rng.normal(0.0, 0.15), 0.0, 1.0)),
        height=float(rng.uniform()),
        proportions=float(rng.uniform()),
    )
    body = make_anny_body(shape)
    size = stature / body.stature
    scaled = replace(body, vertices=size * body.vertices, nodes=size * body.nodes, stature=stature)
    return Build(scaled, heaviness, woman and not child, make_anny_body())


def _size(rng: np.random.Generator, child: bool, woman: bool) -> tuple[float, float]:
    """Sample a stature, metres, and a heaviness."""
    if child:
        return float(rng.uniform(1.0, 1.55)), float(np.clip(rng.normal(0.0, 0.14), -0.2, 0.45))
    stature = float(np.clip(rng.normal(1.63 if woman else 1.76, 0.075), 1.45, 2.0))
    return stature, float(np.clip(rng.normal(np.log(25.5 / _AVERAGE_BMI), 0.19), -0.3, 0.65))


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
