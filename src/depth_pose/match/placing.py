"""Place exemplars at the input, correct them by rendering, and score them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.bank.canonical import CanonicalAxes
from depth_pose.body.coarsen import coarsen
from depth_pose.body.rendered_depth import SCORE_BAND_M, Observation
from depth_pose.core.skeleton import NODE_PARENTS
from depth_pose.match import _match_kernels as kernels
from depth_pose.match.search import Nearest

COARSE_VERTICES = 500
"""Number of vertices of the coarse body: as discriminative as all, in a quarter of the time."""


@dataclass(frozen=True)
class ExemplarViews:
    """Views of poses in canonical axes.

    Attributes
    ----------
    numbers : (N,) int64
        Number of each pose in the bank.
    view_quats : (N, W, 4) float32
        ``R_canonical_model``.
    view_origins : (N, W, 3) float32
        Point of the model, pelvis at the origin, that is placed at the axes' origin, metres.
    """

    numbers: NDArray[np.int64]
    view_quats: NDArray[np.float32]
    view_origins: NDArray[np.float32]


class ScoredExemplars(NamedTuple):
    """Exemplars placed at the input.

    Attributes
    ----------
    exemplars, views : (K,) int64
        Pose in the bank, and its view.
    distances : (K,) float32
        In the subspace.
    rotations, translations : (K, 3, 3), (K, 3) float64
        ``T_camera_model``, metres.
    scores : (K,) float64
        Rendered-depth disagreement.
    shifts : (K, 3) float64
        Translations that would align silhouettes and mean depths, metres.
    nodes : (K, 21, 3) float64
        Camera frame, metres.

    A comparison computes the last three; before it they are empty.
    """

    exemplars: NDArray[np.int64]
    views: NDArray[np.int64]
    distances: NDArray[np.float32]
    rotations: NDArray[np.float64]
    translations: NDArray[np.float64]
    scores: NDArray[np.float64]
    shifts: NDArray[np.float64]
    nodes: NDArray[np.float64]

    def take(self, rows: NDArray[np.int64]) -> ScoredExemplars:
        """Return a subset in the order of ``rows``."""
        return ScoredExemplars._make([column[rows] for column in self])

    def moved(self) -> ScoredExemplars:
        """Return a copy translated by the shifts."""
        return self._replace(translations=self.translations + self.shifts)

    def ranking(self) -> NDArray[np.int64]:
        """Return the row indices by score, the best first."""
        return self.scores.argsort(kind="stable")


def place_exemplars(
    views: ExemplarViews, nearest: Nearest, axes: CanonicalAxes, scale: float
) -> ScoredExemplars:
    """Place views of exemplars, entries ``pose * W + view``, on an input's canonical axes."""
    count = len(nearest.entries)
    rotations, translations = np.empty((count, 3, 3)), np.empty((count, 3))
    kernels.place(
        nearest.entries, views.view_quats, views.view_origins, axes.rotation, axes.origin, scale,
        rotations, translations,
    )  # fmt: skip
    poses, numbers = np.divmod(nearest.entries, views.view_quats.shape[1])
    placed = unscored(views.numbers[poses], rotations, translations)
    return placed._replace(views=numbers, distances=nearest.distances)


def unscored(
    exemplars: NDArray[np.int64], rotations: NDArray[np.float64], translations: NDArray[np.float64]
) -> ScoredExemplars:
    """Return exemplars with given transforms, without view, before any comparison."""
    count = len(exemplars)
    return ScoredExemplars(
        exemplars=exemplars,
        views=np.zeros(count, np.int64),
        distances=np.zeros(count, np.float32),
        rotations=rotations,
        translations=translations,
        scores=np.full(count, np.inf),
        shifts=np.zeros((count, 3)),
        nodes=np.empty((count, len(NODE_PARENTS), 3)),
    )


def better(a: ScoredExemplars, b: ScoredExemplars) -> ScoredExemplars:
    """Return for each row the one with the lower score; the first if equal."""
    rows = np.arange(len(a.scores))
    return join([a, b]).take(np.where(b.scores < a.scores, rows + len(rows), rows))


def join(parts: Sequence[ScoredExemplars]) -> ScoredExemplars:
    """Concatenate several in order."""
    if len(parts) == 1:
        return parts[0]
    return ScoredExemplars._make([np.concatenate(columns) for columns in zip(*parts, strict=True)])


class ExemplarRenderer:
    """Renders a bank's exemplars with a coarse body, and scores them."""

    def __init__(self, bank: Bank) -> None:
        self._quats = bank.pose_quats
        self._skin = coarsen(bank.body, COARSE_VERTICES).skin

    def compare(self, placed: ScoredExemplars, scale: float, observed: Observation) -> ScoredExemplars:
        """Score exemplars where they are placed, and estimate their offsets."""
        compared = placed._replace(
            scores=np.empty(placed.scores.shape),
            shifts=np.empty(placed.shifts.shape),
            nodes=np.empty(placed.nodes.shape),
        )
        kernels.score(compared, self._quats, self._skin, scale, observed, SCORE_BAND_M)
        return compared
