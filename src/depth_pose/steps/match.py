"""Find the exemplars that look like the input, from any view (Sec. 5).

The cloud is put into canonical axes, drawn as a small depth image, projected into the bank's PCA
subspace, and compared with every view of every exemplar there (eq. 6, exact search). The paper
takes the nearest one. Here the nearest few dozen are posed, placed at the input and rendered;
the disagreement of rendered and observed depth ranks them, and several go on to the refinement.
The same score finds the person's size over the first frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.bank.canonical import CanonicalAxes, canonical_axes, describe
from depth_pose.config import MatchConfig
from depth_pose.geometry import matrix_to_quat, quat_to_matrix
from depth_pose.render import DepthComparer
from depth_pose.steps.stamps import StampGuard
from depth_pose.steps.view import PersonView, view_person
from depth_pose.types import Candidate, PersonCloud, PoseMatch

SCALES = tuple(0.62 * 1.065**k for k in range(11))
"""Sizes that are tried at the start: 1.09 m to 2.04 m of stature for a 1.75 m bank body."""

_SAME_POSE_M = 0.05
"""Candidates whose nodes are this close on average are the same pose."""


@dataclass(frozen=True)
class _Placed:
    """An exemplar placed at the input, and its nodes in the camera frame."""

    candidate: Candidate
    nodes: NDArray[np.float64]


class Matcher:
    """The second stage: what `matcher_node` runs."""

    def __init__(self, bank: Bank, config: MatchConfig) -> None:
        self.bank = bank
        self.config = config
        entries = bank.coefficients.reshape(-1, bank.coefficients.shape[-1])
        self._entries = np.ascontiguousarray(entries)
        self._squares = np.einsum("ij,ij->i", entries, entries)
        self._guard = StampGuard()
        self.reset()

    def reset(self) -> None:
        """Forget the person's size."""
        self._scale_scores = np.zeros(len(SCALES))
        self._frames = 0

    def warm_up(self) -> None:
        """Compile every kernel on a view of the bank's own body."""
        body = self.bank.body
        posed = body.pose(np.tile(np.diag([1.0, -1.0, -1.0]), (21, 1, 1)), np.array([0.0, 0.0, 3.0]))
        axes = canonical_axes(posed.vertices)[0]
        self._search(describe(posed.vertices, axes).astype(np.float32), 1)

    def match(self, cloud: PersonCloud) -> PoseMatch:
        """Find the exemplars nearest to a cloud.

        Parameters
        ----------
        cloud : PersonCloud

        Returns
        -------
        PoseMatch
            Best candidate first; without candidates where nobody is in view.
        """
        if self._guard.is_break(cloud.stamp_ns):
            self.reset()
        view = view_person(cloud)
        if view is None:
            return PoseMatch(cloud.stamp_ns, cloud.frame_id, self.bank.bank_id, 0.0, ())
        axes = canonical_axes(view.points)
        scale, placed = self._match_scales(view, axes)
        candidates = tuple(p.candidate for p in self._keep_different(placed))
        return PoseMatch(cloud.stamp_ns, cloud.frame_id, self.bank.bank_id, scale, candidates)

    def _match_scales(
        self, view: PersonView, axes: tuple[CanonicalAxes, ...]
    ) -> tuple[float, list[_Placed]]:
        """Match at the known size, or find the size over the first frames."""
        config = self.config
        if config.scale > 0.0:
            return config.scale, self._match_at(view, axes, config.scale, config.shortlist)
        if self._frames < config.scale_frames:
            few = max(4, config.shortlist // 4)
            for k, scale in enumerate(SCALES):
                best = min(self._match_at(view, axes, scale, few), key=_score)
                self._scale_scores[k] += best.candidate.score
            self._frames += 1
        scale = _lowest(np.array(SCALES), self._scale_scores)
        return scale, self._match_at(view, axes, scale, config.shortlist)

    def _match_at(
        self, view: PersonView, axes: tuple[CanonicalAxes, ...], scale: float, shortlist: int
    ) -> list[_Placed]:
        """Search with each of the input's axes at one size, and compare the best by rendering."""
        comparer = DepthComparer(view.coarse, self.config.score_band)
        placed = []
        for a in axes:
            descriptor = describe(view.points, a, scale).astype(np.float32)
            for entry, distance in self._search(descriptor, max(1, shortlist // len(axes))):
                placed.append(self._place(entry, distance, a, scale, comparer))
        return sorted(placed, key=_score)

    def _search(self, descriptor: NDArray[np.float32], count: int) -> list[tuple[int, float]]:
        """Exact nearest neighbours in the subspace (eq. 6)."""
        gamma = self.bank.components @ (descriptor - self.bank.mean)
        distances = self._squares - 2.0 * (self._entries @ gamma)
        count = min(count, len(distances) - 1)
        nearest = np.argpartition(distances, count)[:count]
        nearest = nearest[np.argsort(distances[nearest], kind="stable")]
        own = float(gamma @ gamma)
        return [(int(i), float(np.sqrt(max(0.0, distances[i] + own)))) for i in nearest]

    def _place(
        self, entry: int, distance: float, axes: CanonicalAxes, scale: float, comparer: DepthComparer
    ) -> _Placed:
        """Place one exemplar at the input, correct its translation by its rendering, and score it."""
        exemplar, view = divmod(entry, self.bank.views)
        r_canonical_model = quat_to_matrix(self.bank.view_quats[exemplar, view].astype(np.float64))
        rotation = axes.rotation.T @ r_canonical_model
        centroid = self.bank.view_origins[exemplar, view].astype(np.float64)
        translation = axes.origin - scale * (rotation @ centroid)

        body = self.bank.body
        posed = body.pose(rotation @ self.bank.rotations(exemplar), translation, scale)
        first = comparer.compare(posed.vertices, body.faces)
        moved = comparer.compare(posed.vertices + first.shift, body.faces)
        shift = first.shift if moved.score < first.score else np.zeros(3)
        candidate = Candidate(
            exemplar=exemplar,
            view=view,
            quat_xyzw=matrix_to_quat(rotation),
            translation=translation + shift,
            distance=distance,
            score=min(first.score, moved.score),
        )
        return _Placed(candidate, posed.nodes + shift)

    def _keep_different(self, placed: list[_Placed]) -> list[_Placed]:
        """Keep the best few that are different poses."""
        kept: list[_Placed] = []
        for p in placed:
            gaps = [np.linalg.norm(p.nodes - k.nodes, axis=1).mean() for k in kept]
            if all(gap > _SAME_POSE_M for gap in gaps):
                kept.append(p)
            if len(kept) == self.config.keep:
                break
        return kept


def _score(placed: _Placed) -> float:
    return placed.candidate.score


def _lowest(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Place of the minimum of a sampled curve, by a parabola through its lowest sample."""
    k = int(np.argmin(y))
    if k in (0, len(x) - 1):
        return float(x[k])
    curve = y[k - 1] - 2 * y[k] + y[k + 1]
    step = 0.5 * (y[k - 1] - y[k + 1]) / curve if curve > 0 else 0.0
    return float(x[k] * (x[k + 1] / x[k]) ** step)
