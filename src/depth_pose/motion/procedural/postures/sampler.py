"""Everyday postures as anatomical angles: standing to lying, drawn at random.

Each posture is a mixture of kinds; a kind draws key angles with their spread, or places hands and
feet and lets the limbs follow. All pass the gates of the motion source: joint limits
(`depth_pose.body.limits`), the shoulder's rhythm, limbs out of the body. Nothing is taken from
recorded motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import rotations_from_angles
from depth_pose.core.errors import ConfigError
from depth_pose.motion.procedural.draw import Draw
from depth_pose.motion.procedural.postures import low as low
from depth_pose.motion.procedural.postures import upright as upright
from depth_pose.motion.procedural.postures.parts import Kind, through_gates
from depth_pose.motion.procedural.postures.seated import SIT

Array = NDArray[np.float64]

POSTURES: dict[str, float] = {
    "stand": 0.30,
    "walk": 0.15,
    "sit": 0.22,
    "lie": 0.06,
    "kneel": 0.035,
    "squat": 0.035,
    "crawl": 0.02,
    "bend": 0.05,
    "reach": 0.07,
    "lean": 0.06,
}
"""Postures and their weights: mostly those of people indoors; rare ones often enough to be learned."""

KINDS: dict[str, tuple[Kind, ...]] = {
    "stand": upright.STAND,
    "walk": upright.WALK,
    "sit": SIT,
    "lie": low.LIE,
    "kneel": low.KNEEL,
    "squat": low.SQUAT,
    "crawl": low.CRAWL,
    "bend": upright.BEND,
    "reach": upright.REACH,
    "lean": upright.LEAN,
}
"""The kinds of every posture."""

_MOST_ROUNDS = 20
"""Maximum number of draws for enough valid postures; beyond it is an error."""


@dataclass(frozen=True)
class Postures:
    """Postures drawn at random.

    Attributes
    ----------
    angles : (N, 47) float64
        Anatomical angles within the joint limits, degrees.
    turns : (N, 3, 3) float64
        Rotation of the whole body, applied last: identity except for lying postures.
    kinds : tuple of Kind
        Kind of each posture.
    """

    angles: Array
    turns: Array
    kinds: tuple[Kind, ...]

    @property
    def rotations(self) -> Array:
        """Segment rotations, rest pose to model frame, (N, 21, 3, 3)."""
        return self.turns[:, None] @ rotations_from_angles(self.angles)


def sample_postures(posture: str, rng: np.random.Generator, count: int = 1) -> Postures:
    """Draw examples of a posture.

    Parameters
    ----------
    posture : str
        One of `POSTURES`.
    rng : numpy.random.Generator
        The same state gives the same postures.
    count : int
        How many; many at once cost far less each.

    Raises
    ------
    ConfigError
        For a posture that is not in `POSTURES`.
    """
    if posture not in KINDS:
        raise ConfigError(f"unknown posture {posture!r}; there are: {', '.join(KINDS)}")
    weights = np.array([kind.weight for kind in KINDS[posture]])
    wanted = rng.choice(len(weights), size=count, p=weights / weights.sum())
    angles, turns = np.zeros((count, 47)), np.tile(np.eye(3), (count, 1, 1))
    for i in np.unique(wanted):
        rows = np.flatnonzero(wanted == i)
        angles[rows], turns[rows] = _of_kind(KINDS[posture][i], rng, len(rows))
    return Postures(angles, turns, tuple(KINDS[posture][i] for i in wanted))


def _of_kind(kind: Kind, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Draw angles and turns of a kind until enough have passed the gates."""
    kept, missing = [], count
    for _ in range(_MOST_ROUNDS):
        angles, fine = through_gates(kind.angles(Draw(rng, (missing + missing // 4 + 2,))))
        kept.append(angles[fine][:missing])
        missing -= len(kept[-1])
        if not missing:
            break
    else:
        raise ConfigError(f"hardly any posture of kind {kind.doing!r} lies within the joint limits")
    turns = np.tile(np.eye(3), (count, 1, 1)) if kind.turn is None else kind.turn(Draw(rng, (count,)))
    return np.concatenate(kept), turns
