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
from depth_pose.bank.canonical import CanonicalAxes, describe
from depth_pose.bank.views import AXES
from depth_pose.config import MatchConfig
from depth_pose.geometry import matrix_to_quat
from depth_pose.registration.articulated import ArticulatedFitter, candidate_pose
from depth_pose.render import Observation
from depth_pose.skeleton import NODE_PARENTS
from depth_pose.steps import _match_kernels as kernels
from depth_pose.steps.sample import sample_cloud
from depth_pose.steps.scale import SCALES, ScaleFinder
from depth_pose.steps.stamps import StampGuard
from depth_pose.steps.view import PersonView, view_person
from depth_pose.types import Candidate, PersonCloud, PoseMatch

_SAME_POSE_M = 0.05
"""Candidates whose nodes are this close on average are the same pose."""


@dataclass(frozen=True)
class _Placed:
    """An exemplar placed at the input, and its nodes in the camera frame."""

    candidate: Candidate
    nodes: NDArray[np.float64]


@dataclass(frozen=True)
class _Nearest:
    """Entries of the bank (exemplar * views + view), nearest first, and their distances."""

    entries: NDArray[np.int64]
    distances: NDArray[np.float32]


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
        """Compile every kernel."""
        self.match(sample_cloud(self.bank))
        self.reset()
        self._guard = StampGuard()

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
        axes = AXES[self.bank.view_scheme](view.points)
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
            sizes = SCALES[::2].tolist() if finder.frames == 0 else [finder.scale]
            few = max(4, config.shortlist // 4)
            tried = [(s, self._match_at(view, axes, s, few)[:2]) for s in sizes]
            scale, best = min(tried, key=lambda t: _score(t[1][0]))
            finder.add(view, [candidate_pose(self.bank, p.candidate, scale) for p in best])
        return finder.scale

    def _match_at(
        self, view: PersonView, axes: tuple[CanonicalAxes, ...], scale: float, shortlist: int
    ) -> list[_Placed]:
        """Search with each of the input's axes at one size, and compare the best by rendering."""
        placed = []
        for a in axes:
            descriptor = describe(view.points, a, scale).astype(np.float32)
            nearest = self._search(descriptor, max(1, shortlist // len(axes)))
            placed += self._place(nearest, a, scale, view.coarse)
        return sorted(placed, key=_score)

    def _search(self, descriptor: NDArray[np.float32], count: int) -> _Nearest:
        """Exact nearest neighbours in the subspace (eq. 6)."""
        gamma = self.bank.components @ (descriptor - self.bank.mean)
        squares = self._squares - 2.0 * (self._entries @ gamma)
        count = min(count, len(squares) - 1)
        nearest = np.argpartition(squares, count)[:count]
        nearest = nearest[np.argsort(squares[nearest], kind="stable")]
        return _Nearest(nearest, np.sqrt(np.maximum(0.0, squares[nearest] + gamma @ gamma)))

    def _place(
        self, nearest: _Nearest, axes: CanonicalAxes, scale: float, observed: Observation
    ) -> list[_Placed]:
        """Place exemplars at the input, correct their translations by their rendering, score them."""
        bank, body, camera = self.bank, self.bank.body, observed.camera
        count = len(nearest.entries)
        scores, rotations = np.empty(count), np.empty((count, 3, 3))
        translations, nodes = np.empty((count, 3)), np.empty((count, len(body.nodes), 3))
        skin = body.sparse_weights
        kernels.score_exemplars(
            nearest.entries, bank.pose_quats, bank.view_quats, bank.view_origins,
            axes.rotation, axes.origin, scale,
            body.vertices, body.nodes, NODE_PARENTS, skin.nodes, skin.weights, body.faces,
            observed.depth, observed.labels, camera.fx, camera.fy, camera.cx, camera.cy,
            self.config.score_band, scores, rotations, translations, nodes,
        )  # fmt: skip
        quats = matrix_to_quat(rotations)
        return [
            _Placed(
                Candidate(
                    exemplar=int(entry) // bank.views,
                    view=int(entry) % bank.views,
                    quat_xyzw=quats[k],
                    translation=translations[k],
                    distance=float(nearest.distances[k]),
                    score=float(scores[k]),
                ),
                nodes[k],
            )
            for k, entry in enumerate(nearest.entries)
        ]

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
