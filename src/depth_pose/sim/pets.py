"""Dogs and cats that walk: quadrupeds of rounded parts with a gait.

A pet is a build, `Pet`, which gives its shapes at any phase of its gait; it faces +z of its own floor. Legs
move in the order of a walk (left hind, left fore, right hind, right fore, a quarter of a cycle apart) or in
diagonal pairs (trot); a paw is on the floor for `_STANCE` of a cycle and moves back evenly while it is.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.sim.materials import sample_dark
from depth_pose.sim.shapes import Assembly, Kind, random_albedo

Array = NDArray[np.float64]

GAITS: dict[str, tuple[float, float, float, float]] = {
    "walk": (0.0, 0.5, 0.25, 0.75),
    "trot": (0.0, 0.5, 0.5, 0.0),
}
"""Phases of the left hind, right hind, left fore and right fore leg, cycles."""
_STANCE = 0.6
"""Share of a cycle that a paw is on the floor."""
_DARK_SHARE = 0.35
"""Share of pets with a coat that returns little light."""
_CATS = 0.35
"""Share of cats among pets."""
_POSTURES = {"walk": 0.45, "stand": 0.2, "sit": 0.2, "lie": 0.15}
"""Postures of a pet in a single image, and their shares."""


@dataclass(frozen=True)
class Pet:
    """Build of a dog or cat; lengths in metres.

    Attributes
    ----------
    high : float
        Height at the shoulder.
    long : float
        Shoulder to rump.
    chest, waist : float
        Radii of the trunk at both ends.
    leg : float
        Radius of a foreleg.
    neck : float
        Length.
    raised : float
        Elevation of the neck, radians.
    head, snout : float
        Radius of the head and length of the snout.
    ear : float
        Length; negative for ears that hang.
    tail : float
        Length.
    wag : float
        Elevation of the tail, radians.
    stride : float
        Length of a step cycle, metres.
    gait : str
        One of `GAITS`.
    albedo : float
    seed : int
        Of the unevenness of its coat.
    """

    high: float
    long: float
    chest: float
    waist: float
    leg: float
    neck: float
    raised: float
    head: float
    snout: float
    ear: float
    tail: float
    wag: float
    stride: float
    gait: str
    albedo: float
    seed: int

    def shapes(self, phase: float = 0.0, posture: str = "walk", pace: float = 1.0) -> Assembly:
        """Make its shapes.

        Parameters
        ----------
        phase : float
            Of the gait, cycles.
        posture : str
            ``walk``, ``stand``, ``sit`` or ``lie``.
        pace : float
            Length of its steps relative to `stride`; 0 stands on four straight legs.
        """
        thing = Assembly(Kind.PET, self.albedo)
        bob = 0.02 * self.high * np.cos(4 * np.pi * phase) if posture == "walk" else 0.0
        top = self.high - self.chest + bob
        low = 0.85 * self.chest
        long = self.long * (0.65 if posture == "sit" else 1.0)
        rump = np.array(
            [0.0, low if posture in ("sit", "lie") else top + 0.3 * (self.chest - self.waist), 0.0]
        )
        fore = np.array([0.0, low if posture == "lie" else top, 0.0])
        rump[2], fore[2] = -0.5 * long, 0.5 * long
        self._trunk(thing, rump, fore)
        for k, start in enumerate(GAITS[self.gait]):
            side, hind = (1.0, -1.0)[k % 2], k < 2
            root = (rump if hind else fore) + [0.6 * side * (self.waist if hind else self.chest), 0.0, 0.0]
            if posture == "lie" or (posture == "sit" and hind):
                paw = np.array([1.3 * root[0], self.leg, root[2] + (0.45 if hind else 0.6) * self.high])
            else:
                reach, lift = _step(phase + start)
                step = 0.5 * self.stride * pace if posture == "walk" else 0.0
                paw = np.array([root[0], 0.06 * self.high * lift * (step > 0), root[2] + step * reach])
            self._limb(thing, root, paw, hind)
        self._front(thing, fore)
        self._rear(thing, rump, phase)
        return thing

    def _trunk(self, thing: Assembly, rump: Array, fore: Array) -> None:
        thing.bar(rump, fore, self.waist, 0.95 * self.chest)
        thing.lump(rump, (0.95 * self.waist, 1.1 * self.waist, 1.15 * self.waist), 0.05)
        thing.lump(fore, (0.9 * self.chest, 1.15 * self.chest, 1.1 * self.chest), 0.05)
        thing.lump(
            fore - [0.0, 0.1 * self.chest, 0.45 * self.chest],
            (0.85 * self.chest, self.chest, self.chest),
            0.05,
        )

    def _limb(self, thing: Assembly, root: Array, paw: Array, hind: bool) -> None:
        """Add a leg of two segments: knees bend forward, elbows backward."""
        thick = self.leg * (1.25 if hind else 1.0)
        bend = (0.12 if hind else -0.07) * self.high
        knee = 0.5 * (root + paw) + [0.0, 0.0, bend]
        thing.lump(0.7 * root + 0.3 * knee, (1.5 * thick, 2.6 * thick, 1.9 * thick), 0.05)
        thing.bar(root, knee, 1.6 * thick, 1.1 * thick)
        if hind:  # the hock
            hock = 0.45 * knee + 0.55 * paw - [0.0, 0.0, 0.8 * bend]
            thing.bar(knee, hock, 1.1 * thick, 0.7 * thick)
            thing.bar(hock, paw, 0.7 * thick, 0.75 * thick)
        else:
            thing.bar(knee, paw, thick, 0.75 * thick)
        thing.lump(paw + [0.0, 0.5 * thick, 0.4 * thick], (0.9 * thick, 0.6 * thick, 1.5 * thick), 0.05)

    def _front(self, thing: Assembly, fore: Array) -> None:
        throat = fore + [0.0, 0.6 * self.chest, 0.4 * self.chest]
        head = throat + self.neck * np.array([0.0, np.sin(self.raised), np.cos(self.raised)])
        head[1] = max(head[1], 1.1 * self.head)
        thing.bar(
            throat - [0.0, 0.3 * self.chest, 0.2 * self.chest], head, 0.6 * self.chest, 0.75 * self.head
        )
        thing.lump(head, (0.9 * self.head, self.head, 1.1 * self.head), 0.04)
        nose = head + [0.0, -0.25 * self.head, self.head + self.snout]
        thing.bar(head, nose, 0.65 * self.head, 0.35 * self.head)
        for side in (-1.0, 1.0):
            root = head + [0.6 * side * self.head, 0.7 * self.head, -0.1 * self.head]
            tip = root + [0.4 * side * abs(self.ear), self.ear, -0.1 * abs(self.ear)]
            thing.bar(root, tip, 0.35 * self.head, 0.06 * self.head)

    def _rear(self, thing: Assembly, rump: Array, phase: float) -> None:
        sway = 0.3 * self.tail * np.sin(4 * np.pi * phase)
        root = rump - [0.0, -0.5 * self.waist, 0.9 * self.waist]
        middle = root + 0.5 * self.tail * np.array([0.0, np.sin(self.wag), -np.cos(self.wag)])
        tip = middle + 0.5 * self.tail * np.array([0.0, np.sin(1.4 * self.wag), -np.cos(1.4 * self.wag)])
        middle[0], tip[0] = 0.3 * sway, sway
        thing.bar(root, np.maximum(middle, [-9.0, 0.02, -9.0]), 0.9 * self.leg, 0.7 * self.leg)
        thing.bar(middle, np.maximum(tip, [-9.0, 0.02, -9.0]), 0.7 * self.leg, 0.35 * self.leg)


def _step(phase: float) -> tuple[float, float]:
    """Return a paw's reach, -1 (behind) to 1 (ahead), and its lift, 0 to 1."""
    at = phase % 1.0
    if at < _STANCE:
        return 1.0 - 2.0 * at / _STANCE, 0.0
    swing = (at - _STANCE) / (1.0 - _STANCE)
    return -float(np.cos(np.pi * swing)), float(np.sin(np.pi * swing))


def sample_pet(rng: np.random.Generator) -> Pet:
    """Sample a dog of any breed's size, or a cat."""
    cat = bool(rng.random() < _CATS)
    high = rng.uniform(0.22, 0.31) if cat else rng.uniform(0.2, 0.78)
    chest = high * (rng.uniform(0.2, 0.27) if cat else rng.uniform(0.19, 0.29))
    head = chest * (rng.uniform(0.65, 0.8) if cat else rng.uniform(0.55, 0.85))
    dark = rng.random() < _DARK_SHARE
    return Pet(
        high=high,
        long=high * (rng.uniform(1.2, 1.5) if cat else rng.uniform(0.85, 1.35)),
        chest=chest,
        waist=chest * rng.uniform(0.6, 0.95),
        leg=high * rng.uniform(0.035, 0.06),
        neck=high * (rng.uniform(0.15, 0.25) if cat else rng.uniform(0.18, 0.42)),
        raised=rng.uniform(-0.3, 1.2),
        head=head,
        snout=head * (rng.uniform(0.1, 0.4) if cat else rng.uniform(0.3, 1.4)),
        ear=head * (rng.uniform(0.6, 1.0) if cat or rng.random() < 0.5 else -rng.uniform(0.6, 1.3)),
        tail=high * (rng.uniform(0.8, 1.2) if cat else rng.uniform(0.15, 0.9)),
        wag=rng.uniform(-0.9, 1.2),
        stride=high * rng.uniform(0.7, 1.3),
        gait=str(rng.choice(list(GAITS))),
        albedo=sample_dark(rng) if dark else random_albedo(rng, 0.2),
        seed=int(rng.integers(2**31)),
    )


def make_walking_pet(rng: np.random.Generator) -> Assembly:
    """Make a pet at a random moment: walking, standing, sitting or lying."""
    posture = str(rng.choice(list(_POSTURES), p=list(_POSTURES.values())))
    return sample_pet(rng).shapes(rng.uniform(), posture, rng.uniform(0.3, 1.2))
