"""Match the tracks of two cameras: a first transform between the cameras, and their clock offset.

Both cameras are levelled by their floors, so the unknowns are a rotation about the vertical, a translation
along the floor and the clock offset. People are points on the floor with a facing direction. Pairs of moments
of two tracks propose transforms, for offsets on a grid; the one with the longest agreement wins and is fitted
to all agreeing moments. The same search with one camera mirrored detects a flipped recording.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.rooms.calibration_walks import Walk

Array = NDArray[np.float64]

SAME_M = 0.25
"""Maximum distance between one person's positions by two cameras (m). Set by hand."""
_SAME_COS = 0.5
"""Minimum cosine between one person's facing directions by two cameras: 60 degrees. Set by hand."""
_FARTHEST_S, _STEP_S, _FINE_S = 0.5, 0.1, 0.02
"""Maximum offset between two clocks, and the grid's steps (s). Set by hand."""
_LEAST_TRACK_S = 1.5
"""Minimum length of a track that proposes transforms (s). Set by hand."""
_MOST_TRACKS = 12
"""Number of each camera's tracks that propose transforms: the longest ones. Set by hand."""
_PROPOSALS = 40
"""Number of pairs of moments that propose a transform, for each pair of tracks and each offset. Set by
hand."""
_APART_M = 0.5
"""Minimum distance between two moments that propose a rotation (m). Set by hand."""
_UNLIKE = 0.3
"""Weight of positions that agree with facing directions that do not. Set by hand."""
_MOST_TRIED = 60
"""Number of proposals that are compared for all people: the best ones. Set by hand."""
_ROUNDS = 6
"""Number of reweighted fits. Set by hand."""


@dataclass(frozen=True)
class PairMatch:
    """Relative pose of two cameras, from people.

    Attributes
    ----------
    turn : float
        About the vertical, floor frame of b to that of a, radians.
    shift : (2,) float64
        Metres.
    offset : float
        The clock of b minus that of a, seconds.
    seconds : float
        Time of people that agrees, seconds.
    common : float
        Time of people during which both cameras saw somebody, so that it could agree, seconds.
    spread : (2,) float64
        Deviation of the agreeing positions along their main directions (m), larger first.
    mirrored : float
        Time of people that would agree with one camera mirrored, seconds.
    """

    turn: float
    shift: Array
    offset: float
    seconds: float
    common: float
    spread: Array
    mirrored: float = 0.0

    @property
    def T_flooring(self) -> Array:
        """Transform from the floor frame of b to that of a, (4, 4)."""
        T = np.eye(4)
        T[:2, :2], T[:2, 3] = _turn_matrix(self.turn), self.shift
        return T


def match_pair(a: list[Walk], b: list[Walk]) -> PairMatch | None:
    """Find the transform and clock offset with the longest agreement; None without any.

    Parameters
    ----------
    a, b : list of Walk
        All tracks of the two cameras.
    """
    proper = _best(a, b)
    if proper is None:
        return None
    flipped = _best(a, [walk.mirrored() for walk in b])
    return proper if flipped is None else PairMatch(**{**vars(proper), "mirrored": flipped.seconds})


def _best(a: list[Walk], b: list[Walk]) -> PairMatch | None:
    rng = np.random.default_rng(0)
    offsets = np.arange(-_FARTHEST_S, _FARTHEST_S + 1e-9, _STEP_S)
    proposed = [
        found
        for first in _longest(a)
        for second in _longest(b)
        for offset in offsets
        if (found := _propose(first, second, float(offset), rng)) is not None
    ]
    if not proposed:
        return None
    promising = sorted(proposed, key=lambda one: -one.score)[:_MOST_TRIED]
    turn, shift, offset, _ = max(promising, key=lambda one: _agreement(a, b, *one[:3]).score)
    turn, shift = _refit(a, b, turn, shift, offset)
    for step in (_STEP_S / 2, _FINE_S):
        around = [offset + k * step for k in range(-3, 4)]
        tried = [(*_refit(a, b, turn, shift, o), o) for o in around]
        turn, shift, offset = max(tried, key=lambda one: _agreement(a, b, *one).score)
    agreed = _agreement(a, b, turn, shift, offset)
    if not agreed.seconds:
        return None
    middle = agreed.places_a - agreed.places_a.mean(axis=0)
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(middle.T @ middle / len(middle)), 0.0))[::-1]
    return PairMatch(turn, shift, offset, agreed.seconds, agreed.common, spread)


def _longest(walks: list[Walk]) -> list[Walk]:
    long = [w for w in walks if w.times[-1] - w.times[0] >= _LEAST_TRACK_S]
    return sorted(long, key=lambda w: -w.seconds.sum())[:_MOST_TRACKS]


def _turn_matrix(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


class _Proposal(NamedTuple):
    """Rotation, translation (m) and clock offset (s), and the time (s) for which two tracks agree."""

    turn: float
    shift: Array
    offset: float
    score: float


def _propose(first: Walk, second: Walk, offset: float, rng: np.random.Generator) -> _Proposal | None:
    """Return the rotation and translation with which most moments of two tracks agree."""
    places, sides, covered = second.at(first.times + offset)
    there = np.flatnonzero(covered)
    if first.seconds[there].sum() < _LEAST_TRACK_S:
        return None
    pa, pb = first.places[there], places[there]
    sa, sb = first.sides[there], sides[there]
    i, j = rng.integers(len(there), size=(2, _PROPOSALS))
    along_a, along_b = pa[i] - pa[j], pb[i] - pb[j]
    far = np.minimum(np.linalg.norm(along_a, axis=1), np.linalg.norm(along_b, axis=1)) > _APART_M
    # if the person hardly moved between two moments, the facing direction gives the rotation
    along_a, along_b = np.where(far[:, None], along_a, sa[i]), np.where(far[:, None], along_b, sb[i])
    turns = _angle(along_a) - _angle(along_b)
    c, s = np.cos(turns), np.sin(turns)
    R = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)
    shifts = pa[i] - np.einsum("nij,nj->ni", R, pb[i])
    off = np.einsum("nij,mj->nmi", R, pb) + shifts[:, None] - pa
    near = np.maximum(0.0, 1.0 - (off**2).sum(-1) / SAME_M**2)
    alike = np.einsum("nij,mj,mi->nm", R, sb, sa) > _SAME_COS
    scores = (near * np.where(alike, 1.0, _UNLIKE)) @ first.seconds[there]
    best = int(np.argmax(scores))
    turn, shift = float(turns[best]), shifts[best]
    for _ in range(3):
        off2 = ((pb @ _turn_matrix(turn).T + shift - pa) ** 2).sum(-1)
        turn, shift = _fit(pa, pb, sa, sb, 1.0 / (1.0 + off2 / SAME_M**2) ** 2)
    return _Proposal(turn, shift, offset, float(scores[best]))


def _angle(vectors: Array) -> Array:
    return np.arctan2(vectors[:, 1], vectors[:, 0])


_SIDE_M = 0.2
"""Distance from the trunk of the points that stand for the facing direction (m): half a shoulder width. Set
by hand."""


def _fit(pa: Array, pb: Array, sa: Array, sb: Array, weight: Array) -> tuple[float, Array]:
    """Fit rotation and translation by weighted least squares, in closed form."""
    weight = weight / max(float(weight.sum()), 1e-12)
    ca, cb = weight @ pa, weight @ pb
    a, b = pa - ca, pb - cb
    cross = weight @ (b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])
    dot = weight @ (a * b).sum(-1)
    cross += _SIDE_M**2 * (weight @ (sb[:, 0] * sa[:, 1] - sb[:, 1] * sa[:, 0]))
    dot += _SIDE_M**2 * (weight @ (sa * sb).sum(-1))
    turn = float(np.arctan2(cross, dot))
    return turn, ca - _turn_matrix(turn) @ cb


@dataclass(frozen=True)
class _Agreement:
    places_a: Array
    places_b: Array
    sides_a: Array
    sides_b: Array
    score: float
    seconds: float
    common: float


def _agreement(a: list[Walk], b: list[Walk], turn: float, shift: Array, offset: float) -> _Agreement:
    """Compare all people of two cameras: each moment of a with the nearest person of b at that time."""
    R = _turn_matrix(turn)
    rows: list[list[Array]] = [[], [], [], []]
    score = seconds = common = 0.0
    for walk in a:
        nearest = np.full(len(walk.times), np.inf)
        place, side = np.zeros_like(walk.places), np.zeros_like(walk.sides)
        for other in b:
            places, sides, covered = other.at(walk.times + offset)
            off = np.linalg.norm(places @ R.T + shift - walk.places, axis=1)
            closer = covered & (off < nearest)
            nearest[closer], place[closer], side[closer] = off[closer], places[closer], sides[closer]
        alike = np.sum((side @ R.T) * walk.sides, axis=1) > _SAME_COS
        same = nearest < SAME_M
        score += float(
            (
                walk.seconds * np.maximum(0.0, 1.0 - (nearest / SAME_M) ** 2) * np.where(alike, 1.0, _UNLIKE)
            ).sum()
        )
        seconds += float(walk.seconds[same].sum())
        common += float(walk.seconds[np.isfinite(nearest)].sum())
        for kept, values in zip(rows, (walk.places, place, walk.sides, side), strict=True):
            kept.append(values[same])
    places_a, places_b, sides_a, sides_b = (np.concatenate([np.zeros((0, 2)), *kept]) for kept in rows)
    return _Agreement(places_a, places_b, sides_a, sides_b, score, seconds, common)


def _refit(a: list[Walk], b: list[Walk], turn: float, shift: Array, offset: float) -> tuple[float, Array]:
    for _ in range(_ROUNDS):
        found = _agreement(a, b, turn, shift, offset)
        if len(found.places_a) < 3:
            break
        off2 = ((found.places_b @ _turn_matrix(turn).T + shift - found.places_a) ** 2).sum(-1)
        weight = 1.0 / (1.0 + off2 / (0.4 * SAME_M) ** 2)
        turn, shift = _fit(found.places_a, found.places_b, found.sides_a, found.sides_b, weight)
    return turn, shift
