"""Loose clothing: sheets of cloth that follow a moving body with a lag.

Cloth is particles held at their distances (position-based dynamics: M. Mueller, B. Heidelberger,
M. Hennix, J. Ratcliff, *Position based dynamics*, J. Vis. Commun. Image R. 18, 2007), pinned to
the body along one edge and pushed out of capsules around legs, trunk and arms. A skirt is a flared
tube pinned around the waist; a sleeve hangs along the arm as in a kimono.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.core.options import Checked, option
from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX
from depth_pose.volume.headings import headings_of, turns

if TYPE_CHECKING:
    from depth_pose.body.body import Body

Array = NDArray[np.float64]

_SUBSTEP_S = 1.0 / 120.0
"""Longest step of the cloth, seconds. As all below, chosen so that cloth looks real."""
_GRAVITY = 9.81
"""Metres per second squared."""
_ROUNDS = 8
"""Iterations over all links in each step."""
_SETTLE_STEPS = 150
"""Steps in which the cloth comes to rest before the first frame."""
_COLUMNS, _SLEEVE_COLUMNS = 32, 8
"""Particles around the waist, and along a sleeve."""
_ROW_M = 0.06
"""Distance of two rows of particles on an adult of 1.75 m, metres."""
_HIPS_M = ((0.06, -0.03, 0.0), 0.115)
"""Half of the capsule across the hips, from the pelvis to the person's left, and its radius; metres."""
_LIMBS_M = {
    ("hip", "knee"): (0.095, 0.065),
    ("knee", "ankle"): (0.065, 0.050),
    ("elbow", "wrist"): (0.035, 0.025),
}
"""Capsules of both sides, by the nodes at their ends, and their radii there on an adult of 1.75 m, metres."""


@dataclass(frozen=True)
class Garment(Checked):
    """A piece of loose clothing; lengths are for a 1.75 m adult and scale with the wearer's height."""

    skirt: float = option(0.55, "Length of the skirt from the waist; 0 for none", unit="m", low=0.0, high=1.1)
    flare: float = option(0.30, "Extra radius of the hem over the waist", unit="m", low=0.0, high=0.6)
    sleeve: float = option(
        0.0, "Length of the sleeves below the arms; 0 for none", unit="m", low=0.0, high=0.8
    )
    drag: float = option(1.5, "Share of the speed lost to air drag each second", low=0.0, high=20.0)


GARMENTS: dict[str, Garment | None] = {
    "none": None,
    "skirt": Garment(),
    "long-skirt": Garment(skirt=0.80, flare=0.22),
    "wide-skirt": Garment(skirt=0.62, flare=0.42, drag=2.5),
    "robe": Garment(skirt=0.85, flare=0.16, sleeve=0.22),
}
"""Garments by name."""


def find_garment(name: str) -> Garment | None:
    """Return a garment by name; None for ``none``."""
    if name not in GARMENTS:
        raise ConfigError(f"there is no garment {name!r}; there are {', '.join(GARMENTS)}")
    return GARMENTS[name]


@dataclass(frozen=True)
class _Sheet:
    """A grid of particles, row by row; the first row is pinned."""

    rest: Array
    wraps: bool

    def _numbers(self, first: int) -> tuple[NDArray[np.int64], ...]:
        """Return the indices of all particles, of those with a right neighbour, and of these neighbours."""
        rows, columns = self.rest.shape[:2]
        at = first + np.arange(rows * columns).reshape(rows, columns)
        return (at, at, np.roll(at, -1, axis=1)) if self.wraps else (at, at[:, :-1], at[:, 1:])

    def links(self, first: int) -> NDArray[np.int64]:
        """Pairs along, across and both diagonals, numbered from `first`."""
        at, here, right = self._numbers(first)
        pairs = [
            (at[:-1], at[1:]), (here[1:], right[1:]), (here[:-1], right[1:]), (right[:-1], here[1:]),
            (here[:1], right[:1]),
        ]  # fmt: skip
        return np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])

    def faces(self, first: int) -> NDArray[np.int32]:
        """Triangles of both sides."""
        _, here, right = self._numbers(first)
        a, b, c, d = (x.ravel() for x in (here[:-1], right[:-1], here[1:], right[1:]))
        one = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
        return np.concatenate([one, one[:, ::-1]]).astype(np.int32)


class Clothes:
    """One person's loose clothing in motion.

    Parameters
    ----------
    garment : Garment
    body : Body
        The wearer.

    Attributes
    ----------
    faces : (F, 3) int32
        Triangles of the cloth, both sides.
    links : (L, 2) int64
        Pairs of vertices that are held at a fixed distance.
    lengths : (L,) float64
        Those distances, metres.
    """

    def __init__(self, garment: Garment, body: Body) -> None:
        self._garment, self._size = garment, body.stature / ADULT_STATURE_M
        self._wide = _waist(body)
        sheets = [self._skirt()] if garment.skirt > 0 else []
        if garment.sleeve > 0:
            sheets += [self._sleeve(body, side) for side in ("left", "right")]
        if not sheets:
            raise ConfigError("a garment needs a skirt or sleeves")
        # pinned rows first, as the kernel wants them
        rests = [s.rest.reshape(-1, 3) for s in sheets]
        firsts = np.cumsum([0, *map(len, rests)])
        at = list(zip(firsts[:-1], sheets, strict=True))
        pinned = np.concatenate([a + np.arange(s.rest.shape[1]) for a, s in at])
        order = np.concatenate([pinned, np.setdiff1d(np.arange(firsts[-1]), pinned)])
        place = np.argsort(order)
        self._sheets, self._rest = sheets, np.concatenate(rests)[order]
        self.links = place[np.concatenate([s.links(a) for a, s in at])]
        ends = self._rest[self.links]
        self.lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        self.faces = place[np.concatenate([s.faces(a) for a, s in at])].astype(np.int32)
        self._now: Array | None = None
        self._before = self._rest.copy()

    def _skirt(self) -> _Sheet:
        """Flared tube below the waist, relative to the pelvis, hanging."""
        length, flare = self._garment.skirt * self._size, self._garment.flare * self._size
        rows = max(3, round(length / (_ROW_M * self._size)) + 1)
        down = np.linspace(0.0, 1.0, rows)
        angle = 2 * np.pi * np.arange(_COLUMNS) / _COLUMNS
        ring = np.stack([self._wide[0] * np.sin(angle), 0 * angle, self._wide[1] * np.cos(angle)], axis=1)
        out = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
        sheet = ring[None] + flare * down[:, None, None] * out
        sheet[..., 1] = 0.05 * self._size - down[:, None] * np.sqrt(max(length**2 - flare**2, 0.01))
        return _Sheet(sheet, wraps=True)

    def _sleeve(self, body: Body, side: str) -> _Sheet:
        """Sheet that hangs from the middle of the upper arm to the wrist."""
        drop = self._garment.sleeve * self._size
        rows = max(3, round(drop / (_ROW_M * self._size)) + 1)
        line = self._arm_line(body.nodes, side)
        hang = np.linspace(0.0, drop, rows)[:, None, None] * np.array([0.0, -1.0, 0.0])
        return _Sheet(line[None] + hang, wraps=False)

    @staticmethod
    def _arm_line(nodes: Array, side: str) -> Array:
        shoulder, elbow, wrist = (nodes[NODE_INDEX[f"{side}_{n}"]] for n in ("shoulder", "elbow", "wrist"))
        s = np.linspace(0.0, 1.0, _SLEEVE_COLUMNS)[:, None]
        start = 0.5 * (shoulder + elbow)
        return np.where(s < 0.4, start + s / 0.4 * (elbow - start), elbow + (s - 0.4) / 0.6 * (wrist - elbow))

    def _pins(self, nodes: Array, rotations: Array) -> Array:
        pins = []
        sheets = list(self._sheets)
        if self._garment.skirt > 0:
            ring = sheets.pop(0).rest[0]
            pins.append(nodes[0] + ring @ rotations[0].T)
        for side, _ in zip(("left", "right"), sheets, strict=False):
            pins.append(self._arm_line(nodes, side))
        return np.concatenate(pins)

    def _capsules(self, nodes: Array, rotations: Array) -> tuple[Array, Array]:
        aside = rotations[0] @ (self._size * np.array(_HIPS_M[0]))
        ends, radii = [(nodes[0] - aside, nodes[0] + aside)], [(_HIPS_M[1], _HIPS_M[1])]
        for side in ("left", "right"):
            for (a, b), size in _LIMBS_M.items():
                ends.append((nodes[NODE_INDEX[f"{side}_{a}"]], nodes[NODE_INDEX[f"{side}_{b}"]]))
                radii.append(size)
        return np.array(ends), self._size * np.array(radii)

    def reset(self) -> None:
        """Forget the motion; the next step settles the cloth first."""
        self._now = None

    def step(self, nodes: Array, rotations: Array, seconds: float) -> Array:
        """Advance the cloth by one step and return its vertices.

        Parameters
        ----------
        nodes : (21, 3)
            The wearer's nodes, y up, metres.
        rotations : (21, 3, 3)
            Segment rotations.
        seconds : float
            Time since the previous step.

        Returns
        -------
        (P, 3) float64
        """
        from depth_pose.sim._cloth_kernels import Capsules, Cloth, step_cloth  # numba only for cloth

        pins = self._pins(nodes, rotations)
        capsules, radii = self._capsules(nodes, rotations)
        steps = max(1, round(seconds / _SUBSTEP_S))
        if self._now is None:
            turn = turns(headings_of(rotations))
            self._now = np.ascontiguousarray(nodes[0] + self._rest @ turn.T)
            self._now[: len(pins)] = pins
            self._before = self._now.copy()
            self._held = (pins, capsules)
            steps = _SETTLE_STEPS
        dt = seconds / steps if steps != _SETTLE_STEPS else _SUBSTEP_S
        keep = float(np.exp(-self._garment.drag * dt))
        cloth = Cloth(self._now, self._before, self.links, self.lengths)
        for i in range(steps):
            s = (i + 1) / steps
            between = Capsules(self._held[1] + s * (capsules - self._held[1]), radii)
            pinned = self._held[0] + s * (pins - self._held[0])
            step_cloth(cloth, pinned, between, _GRAVITY * dt * dt, keep, _ROUNDS)
        self._held = (pins, capsules)
        return self._now.copy()


def _waist(body: Body) -> Array:
    """Half width and half depth of the body at the waist, with a centimetre of room."""
    height = body.nodes[0, 1] + 0.05 * body.stature / ADULT_STATURE_M
    near = np.abs(body.vertices[:, 1] - height) < 0.03
    trunk = body.vertices[near & (body.weights[:, :3].sum(axis=1) > 0.5)] - body.nodes[0]
    return np.asarray(np.abs(trunk[:, [0, 2]]).max(axis=0) + 0.01)
