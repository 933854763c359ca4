"""Simulated people for simulated rooms: builds, postures, clothes, hair, bags, things in hands.

A figure is a static mesh with its joints. Everything is drawn from one generator, from tables of
everyday postures and from the embedded body; nothing comes from recordings.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.angles import ANGLE_INDEX, ARM, LEG, SIDES, TRUNK, rotations_from_angles
from depth_pose.body.feet import heel_vertices
from depth_pose.body.limits import clamp_angles, with_shoulder_rhythm
from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.motion.contact import separate_limbs
from depth_pose.motion.procedural.postures.parts import Kind
from depth_pose.motion.procedural.postures.sampler import POSTURES, Postures, sample_postures
from depth_pose.motion.reach import arm_to_target
from depth_pose.sim import _garments as garments
from depth_pose.sim import _things as things
from depth_pose.sim._builds import draw_build
from depth_pose.sim._contact import put_down
from depth_pose.sim._dressed_skin import draw_cut, dress
from depth_pose.sim._garments import Wearer
from depth_pose.sim._meshes import Piece, join

__all__ = ["POSTURES", "Figure", "sample_figure"]

Array = NDArray[np.float64]

POOL = 1200
"""Number of postures per name in a process's pool; each figure varies its posture slightly."""

NOISE_DEG = 3.0
"""Spread of that variation in arms, neck and head; legs and trunk vary half as much."""

LOOSE_NOISE_DEG, FREE_ARM_SHARE = 9.0, 0.4
"""The same spread for loose postures, and the share of their arms that point anywhere."""

HANDS_M = {
    "frame": ((0.08, -0.44, 0.30), (0.08, -0.44, 0.30)),
    "crutches": ((0.14, -0.50, 0.10), (0.14, -0.50, 0.10)),
    "child": ((-0.10, -0.30, 0.26), (-0.06, -0.14, 0.26)),
}
"""Wrists relative to the shoulders of people with a walking frame, crutches or a child: away from the trunk,
up and forward, metres on the 1.75 m body; the left hand, the right hand."""

HOLDS_M = {
    "cloth": ((0.10, -0.06, 0.42), (0.10, -0.06, 0.42)),
    "board": ((0.16, -0.24, 0.32), (0.16, -0.24, 0.32)),
}
"""The same for people who hold up a cloth or a board in front of them; only on request."""

AIDED = {"stand": 0.16, "walk": 0.16}
"""Share of each posture with a walking aid or a child (`HANDS_M`)."""

ADULT_M = 1.45
"""Minimum stature of people who carry children, metres."""

CLOAKS, SKIRTS, COATS = 0.025, 0.10, 0.09
"""Shares of people who wear each: as in public places, with more cloaks."""

_POOL_SEED = 815
"""Seed of the postures; any would do."""
_UPRIGHT = ("stand", "walk", "sit", "lean", "reach")


@dataclass(frozen=True)
class Figure:
    """A simulated person.

    The frame: metres, y up, x to the figure's left, the figure faces +z (lying figures lie along z),
    origin on the floor below the pelvis.

    Attributes
    ----------
    vertices : (V, 3) float32
    faces : (F, 3) int32
        Skin, clothes, hair, worn objects: all that counts as the person.
    joints : (19, 3) float32
        In the order of `depth_pose.core.skeleton.JOINTS`, metres.
    heels : (2, 3) float32
        Backs of the left and the right heel, metres.
    held_vertices : (H, 3) float32
    held_faces : (G, 3) int32
        Objects in the hands, which do not count as the person; may be empty.
    posture : str
        One of `POSTURES`.
    seat_height : float
        Height of the chair, sofa or bed that the figure rests on, metres; 0 when it rests on
        the floor.
    stature : float
        Height standing upright, metres.
    doing : str
        Activity: as in `depth_pose.motion.procedural.postures.parts.Kind`, or one of `HANDS_M` or `HOLDS_M`.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    joints: NDArray[np.float32]
    heels: NDArray[np.float32]
    held_vertices: NDArray[np.float32]
    held_faces: NDArray[np.int32]
    posture: str
    seat_height: float
    stature: float
    doing: str = "free"


def sample_figure(
    rng: np.random.Generator,
    posture: str | None = None,
    loose: bool = False,
    doing: str | None = None,
    tallest: float = np.inf,
    anny: float = 0.0,
    wrapped: float = 1.0,
) -> Figure:
    """Draw a person.

    The first figures of a process cost seconds (the body, postures, builds); later ones
    milliseconds.

    Parameters
    ----------
    rng : numpy.random.Generator
        The same state gives the same figure, regardless of earlier draws.
    posture : str, optional
        One of `POSTURES`; drawn by their probabilities when left out.
    loose : bool
        Vary the posture widely: halfway to another of its kind, and with arms that point anywhere; and
        sample a new build for this figure alone.
    doing : str, optional
        One of `HANDS_M` or `HOLDS_M`; of `HANDS_M` and at random by default.
    tallest : float
        Maximum stature, metres.
    anny : float
        Share of bodies of Anny, which need the extra ``anny``; the others are of the embedded family.

    wrapped : float
        Factor on the shares of people in cloaks, skirts and coats, and with bags.

    Raises
    ------
    ConfigError
        For a posture that is not in `POSTURES`.
    """
    if posture is None:
        share = np.array(list(POSTURES.values()))
        posture = str(rng.choice(list(POSTURES), p=share / share.sum()))
    elif posture not in POSTURES:
        raise ConfigError(f"unknown posture {posture!r}; there are: {', '.join(POSTURES)}")
    build = draw_build(rng, tallest, anny, is_new=loose)
    if doing is None and rng.random() < AIDED.get(posture, 0.0):
        doing = str(rng.choice([name for name in HANDS_M if name != "child" or build.body.stature > ADULT_M]))
    rotations, kind = _draw_rotations(rng, posture, loose, doing)
    doing = doing or kind.doing
    posed = build.body.pose(rotations, np.zeros(3))
    cut = draw_cut(rng, build)
    skin = dress(rng, posed.vertices, build, cut)
    rested = put_down(rng, (skin, posed.nodes, rotations), build, posture, kind.raised)
    floor = rested.seat if posture == "lie" else 0.0
    wearer = Wearer(
        rested.skin, rested.nodes, rested.rotations, build.body.weights, build.body.stature, floor
    )
    worn = draw_worn(rng, wearer, posture, build.woman, wrapped)
    vertices, faces = join([(rested.skin, build.body.faces), *worn])
    held_vertices, held_faces = join(things.belongings(rng, wearer, doing))
    return Figure(
        vertices.astype(np.float32),
        faces,
        rested.nodes[JOINT_NODES].astype(np.float32),
        rested.skin[heel_vertices(build.body)].astype(np.float32),
        held_vertices.astype(np.float32),
        held_faces,
        posture,
        rested.seat,
        build.body.stature,
        doing,
    )


@lru_cache(maxsize=len(POSTURES))
def _pool(posture: str) -> Postures:
    rng = np.random.default_rng([_POOL_SEED, list(POSTURES).index(posture)])
    return sample_postures(posture, rng, POOL)


def _draw_rotations(
    rng: np.random.Generator, posture: str, loose: bool = False, doing: str | None = None
) -> tuple[Array, Kind]:
    """Pick a posture from the pool and vary it, (21, 3, 3)."""
    pool, i = _pool(posture), int(rng.integers(POOL))
    noise_deg = LOOSE_NOISE_DEG if loose else NOISE_DEG
    spread = np.full(47, noise_deg)
    spread[TRUNK.start : 9] *= 0.5
    for leg in LEG:
        spread[leg] *= 0.5
    angles = pool.angles[i]
    if loose:
        others = [j for j in rng.integers(POOL, size=6) if pool.kinds[j] is pool.kinds[i]]
        if others:
            angles = angles + rng.uniform(0.0, 0.6) * (pool.angles[others[0]] - angles)
        angles = _with_free_arms(angles, rng)
    if doing is not None:
        angles = _with_hands(angles, rng, doing)
    angles = clamp_angles(angles + spread * rng.normal(size=47))
    rotations = separate_limbs(rotations_from_angles(angles)[None]).rotations[0]
    return pool.turns[i] @ rotations, pool.kinds[i]


def _with_free_arms(angles: Array, rng: np.random.Generator) -> Array:
    """Point some arms in any direction within the shoulder's range, also behind the trunk and overhead."""
    out = angles.copy()
    for side, arm in zip(SIDES, ARM, strict=True):
        if rng.random() > FREE_ARM_SHARE:
            continue
        out[arm] = 0.0
        elevation, plane = rng.uniform(0.0, 165.0), np.radians(rng.uniform(-140.0, 140.0))
        straight = rng.random() < 0.3
        for name, value in (
            ("shoulder_flexion", elevation * np.cos(plane)),
            ("shoulder_abduction", elevation * np.sin(plane)),
            ("shoulder_twist", rng.uniform(-80.0, 110.0)),
            ("elbow_flexion", rng.uniform(0.0, 20.0) if straight else rng.uniform(0.0, 145.0)),
            ("forearm_pronation", rng.uniform(-70.0, 70.0)),
        ):
            out[ANGLE_INDEX[f"{side}_{name}"]] = value
        out[arm] = with_shoulder_rhythm(out)[arm]
    return out


def _with_hands(angles: Array, rng: np.random.Generator, doing: str) -> Array:
    """Move both hands to the positions for holding an object."""
    out, swapped = angles.copy(), bool(rng.random() < 0.5)
    aside = rng.normal(0, (0.03, 0.05, 0.04))
    for k, arm in enumerate(ARM):
        target = np.array((HANDS_M | HOLDS_M)[doing][k ^ swapped]) + aside + rng.normal(0, 0.02, 3)
        out[arm] = arm_to_target(target, np.array([0.4, -0.4, -1.0]) + rng.normal(0, 0.2, 3))
        out[arm] = with_shoulder_rhythm(out)[arm]
    return out


def draw_seated(rng: np.random.Generator) -> Array:
    """Sample a pose of a person on a chair, stool or sofa: rotations (21, 3, 3), facing +z."""
    while True:
        rotations, kind = _draw_rotations(rng, "sit")
        if kind.raised:
            return rotations


def draw_worn(
    rng: np.random.Generator, wearer: Wearer, posture: str, woman: bool, wrapped: float = 1.0
) -> list[Piece]:
    """Draw hanging clothes, hair and bags; ``wrapped`` is a factor on the shares of clothes and bags."""
    worn: list[Piece] = []
    if posture in _UPRIGHT and rng.uniform() < wrapped * CLOAKS:
        worn.append(garments.cloak(rng, wearer, rng.uniform(0.4, 1.35), bool(rng.uniform() < 0.4)))
    elif posture not in ("crawl", "squat", "kneel", "bend"):
        chance = rng.uniform()
        if chance < wrapped * SKIRTS * (1.7 if woman else 0.3):
            worn.append(garments.skirt(rng, wearer, rng.uniform(0.3, 1.0), rng.uniform(0.0, 0.16), False))
        elif chance > 1.0 - wrapped * COATS:
            opened = bool(rng.uniform() < 0.5)
            worn.append(garments.skirt(rng, wearer, rng.uniform(0.2, 0.75), rng.uniform(0.0, 0.07), opened))
    return worn + _draw_headwear(rng, wearer, woman) + _draw_bags(rng, wearer, posture, wrapped)


def _draw_headwear(rng: np.random.Generator, wearer: Wearer, woman: bool) -> list[Piece]:
    worn: list[Piece] = []
    if rng.uniform() < (0.45 if woman else 0.08):
        worn.append(garments.hanging_hair(rng, wearer, rng.uniform(0.05, 0.35)))
    elif rng.uniform() < (0.25 if woman else 0.03):
        worn.append(things.bun(rng, wearer))
    if rng.uniform() < 0.10:
        worn += things.hat(rng, wearer)
    if rng.uniform() < 0.06:
        worn.append(garments.scarf(rng, wearer))
    return worn


def _draw_bags(rng: np.random.Generator, wearer: Wearer, posture: str, wrapped: float) -> list[Piece]:
    chance = rng.uniform()
    if posture == "lie":
        return []
    if chance < wrapped * 0.09:
        return [things.backpack(rng, wearer)]
    if chance > 1.0 - wrapped * 0.06:
        return [things.shoulder_bag(rng, wearer)]
    return []
