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
from depth_pose.registration.articulated import ArticulatedFitter, BodyPose
from depth_pose.render import DepthComparer
from depth_pose.steps.scale import SCALES, ScaleFinder
from depth_pose.steps.stamps import StampGuard
from depth_pose.steps.view import PersonView, view_person
from depth_pose.types import Candidate, PersonCloud, PoseMatch

_SAME_POSE_M = 0.05
"""Candidates whose nodes are this close on average are the same pose."""


@dataclass(frozen=True)
class _Placed:
    """An exemplar placed at the input: its segment rotations and nodes in the camera frame."""

    candidate: Candidate
    scale: float
    rotations: NDArray[np.float64]
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
        self._finder = ScaleFinder(ArticulatedFitter(bank.body), config.score_band)

    def reset(self) -> None:
        """Forget the person's size."""
        self._finder.reset()

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
            self.reset()
            return PoseMatch(cloud.stamp_ns, cloud.frame_id, self.bank.bank_id, 0.0, ())
        axes = canonical_axes(view.points)
        scale = self._find_scale(view, axes)
        placed = self._match_at(view, axes, scale, self.config.shortlist)
        candidates = tuple(p.candidate for p in self._keep_different(placed))
        return PoseMatch(cloud.stamp_ns, cloud.frame_id, self.bank.bank_id, scale, candidates)

    def _find_scale(self, view: PersonView, axes: tuple[CanonicalAxes, ...]) -> float:
        """Give the person's size: as configured, or found over the first frames."""
        config, finder = self.config, self._finder
        if config.scale > 0.0:
            return config.scale
        if finder.frames < config.scale_frames:
            sizes = SCALES[::2] if finder.frames == 0 else [finder.scale]
            few = max(4, config.shortlist // 4)
            tried = [self._match_at(view, axes, float(s), few)[:2] for s in sizes]
            best = min(tried, key=lambda placed: _score(placed[0]))
            finder.add(view, [BodyPose(p.rotations, p.candidate.translation, p.scale) for p in best])
        return finder.scale

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
        rotations = rotation @ self.bank.rotations(exemplar)
        posed = body.pose(rotations, translation, scale)
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
        return _Placed(candidate, scale, rotations, posed.nodes + shift)

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

