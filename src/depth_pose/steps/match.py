"""Find the exemplars that look like the input, from any view (Sec. 5).

The cloud is put into canonical axes, drawn as a small depth image, projected into the bank's PCA
subspace, and compared with every view of every exemplar there (eq. 6, exact search). The paper
takes the nearest one. Here the nearest few dozen are posed, placed at the input and rendered;
the disagreement of rendered and observed depth ranks them, and several go on to the refinement.
The same score finds the person's size over the first frames.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.bank.canonical import describe
from depth_pose.bank.views import AXES
from depth_pose.config import MatchConfig
from depth_pose.registration.articulated import ArticulatedFitter, candidate_pose
from depth_pose.steps.cut_off import UprightExemplars, head_axes, is_cut_off, touches_side
from depth_pose.steps.identity import PersonGuard
from depth_pose.steps.placing import ExemplarViews, Nearest, Placed, place_exemplars
from depth_pose.steps.sample import sample_cloud
from depth_pose.steps.scale import SCALES, ScaleFinder
from depth_pose.steps.stamps import StampGuard
from depth_pose.steps.view import PersonView, view_person
from depth_pose.types import PersonCloud, PoseMatch

_NEW_PERSON = 3
"""Longer shortlist of a person whose size is still being found: no earlier pose helps then."""

_MORE = 1.2
"""How much more must be seen of a person who is cut off before their size is found again."""

_SAME_POSE_M = 0.05
"""Candidates whose nodes are this close on average are the same pose."""


class Matcher:
    """The second stage: what `matcher_node` runs."""

    def __init__(self, bank: Bank, config: MatchConfig) -> None:
        self.bank = bank
        self.config = config
        entries = bank.coefficients.reshape(-1, bank.coefficients.shape[-1])
        self._entries = np.ascontiguousarray(entries)
        self._squares = np.einsum("ij,ij->i", entries, entries)
        self._views = ExemplarViews(
            np.arange(bank.poses), bank.pose_quats, bank.view_quats, bank.view_origins
        )
        self._upright = UprightExemplars(bank)
        self._guard = StampGuard()
        self._identity = PersonGuard()
        self._finder = ScaleFinder(ArticulatedFitter(bank.body), config.score_band)
        self.reset()

    def reset(self) -> None:
        """Forget the person's size."""
        self._finder.reset()
        self._partial, self._shown = False, 0.0

    def warm_up(self) -> None:
        """Compile every kernel."""
        self.match(sample_cloud(self.bank))
        self.reset()
        self._guard, self._identity = StampGuard(), PersonGuard()

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
        if self._identity.is_other(view, cloud.stamp_ns):
            self.reset()
        self._identity.note(view, cloud.stamp_ns)
        self._await_whole(cloud, view)
        scale = self._find_scale(cloud, view)
        shortlist = self.config.shortlist * (1 if self._knows_scale() else _NEW_PERSON)
        placed = self._match_at(cloud, view, scale, shortlist)
        candidates = tuple(p.candidate for p in self._keep_different(placed))
        return PoseMatch(cloud.stamp_ns, cloud.frame_id, self.bank.bank_id, scale, candidates)

    def _knows_scale(self) -> bool:
        """Tell whether the size is given, or was found and is held."""
        return self.config.scale > 0.0 or self._finder.frames >= self.config.scale_frames

    def _await_whole(self, cloud: PersonCloud, view: PersonView) -> None:
        """Find the size of a person who comes in from the side anew, as more is seen of them."""
        if touches_side(cloud):
            self._partial = self._partial or not self._knows_scale()
            shown = len(view.points) * float(np.median(view.points[:, 2])) ** 2
            if self._partial and shown > _MORE * self._shown:
                self._finder.reset()
                self._shown = shown
        elif self._partial:
            self.reset()

    def _find_scale(self, cloud: PersonCloud, view: PersonView) -> float:
        """Give the person's size: as configured, or found over the first frames."""
        config, finder = self.config, self._finder
        if config.scale > 0.0:
            return config.scale
        if not self._knows_scale():
            sizes = SCALES[::2].tolist() if finder.frames == 0 else [finder.scale]
            few = max(4, config.shortlist // 4)
            tried = [(s, self._match_at(cloud, view, s, few)[:2]) for s in sizes]
            scale, best = min(tried, key=lambda t: _score(t[1][0]))
            finder.add(view, [candidate_pose(self.bank, p.candidate, scale) for p in best])
        return finder.scale

    def _match_at(self, cloud: PersonCloud, view: PersonView, scale: float, shortlist: int) -> list[Placed]:
        """Search with each of the input's axes at one size, and compare the best by rendering."""
        body, band = self.bank.body, self.config.score_band
        axes = AXES[self.bank.view_scheme](view.points)
        placed = []
        for a in axes:
            descriptor = describe(view.points, a, scale).astype(np.float32)
            nearest = self._search(descriptor, max(1, shortlist // len(axes)))
            placed += place_exemplars(body, self._views, nearest, a, scale, view.coarse, band)
        if is_cut_off(cloud):
            hung = head_axes(view.points, scale)
            upright = self._upright
            placed += place_exemplars(body, upright.views, upright.all, hung, scale, view.coarse, band)
        return sorted(placed, key=_score)

    def _search(self, descriptor: NDArray[np.float32], count: int) -> Nearest:
        """Exact nearest neighbours in the subspace (eq. 6)."""
        gamma = self.bank.components @ (descriptor - self.bank.mean)
        squares = self._squares - 2.0 * (self._entries @ gamma)
        count = min(count, len(squares) - 1)
        nearest = np.argpartition(squares, count)[:count]
        nearest = nearest[np.argsort(squares[nearest], kind="stable")]
        return Nearest(nearest, np.sqrt(np.maximum(0.0, squares[nearest] + gamma @ gamma)))

    def _keep_different(self, placed: list[Placed]) -> list[Placed]:
        """Keep the best few that are different poses."""
        kept: list[Placed] = []
        for p in placed:
            gaps = [np.linalg.norm(p.nodes - k.nodes, axis=1).mean() for k in kept]
            if all(gap > _SAME_POSE_M for gap in gaps):
                kept.append(p)
            if len(kept) == self.config.keep:
                break
        return kept


def _score(placed: Placed) -> float:
    return placed.candidate.score
