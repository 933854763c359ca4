"""Exemplars of the bank for one person at one size, placed, compared and ranked (Sec. 5).

Where joints were measured, the exemplars nearest to them are the shortlist
(`depth_pose.match.proposed_exemplars`). Otherwise the cloud is transformed to canonical axes, drawn as a
small depth image, projected into the bank's PCA subspace, and compared with every view of every exemplar
there (Ye et al. eq. 6, exact search). The paper takes the nearest one; here the nearest few dozen are the
shortlist. It is posed, placed at the input and rendered as small images, and the best of it as larger ones.
The disagreement of rendered and observed depth, the first term of `depth_pose.refine.objective`, ranks them.
"""

from __future__ import annotations

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.bank.canonical import describe
from depth_pose.bank.views import AXES
from depth_pose.body.pose import BodyPose
from depth_pose.core.pose_match import Candidate
from depth_pose.match._match_kernels import keep_different
from depth_pose.match.placing import (
    ExemplarRenderer,
    ExemplarViews,
    ScoredExemplars,
    better,
    join,
    place_exemplars,
)
from depth_pose.match.proposed_exemplars import ProposedExemplars
from depth_pose.match.scale import SCALES
from depth_pose.match.search import SubspaceSearch
from depth_pose.match.tuning import MatchTuning
from depth_pose.match.upright_exemplars import UprightExemplars, head_axes
from depth_pose.track.person_view import PersonView

_ROUGH_M, _FINE_M = 0.08, 0.04
"""Maximum pixel spacing at the person (m) of the coarse comparison, and of the fine one."""

_FINALISTS = 16
"""Number of exemplars compared in the fine image, as placed and corrected."""

_SAME_POSE_M = 0.05
"""Candidates with a mean node distance below this (m) are the same pose."""


class ExemplarSource:
    """Finds exemplars for people.

    Parameters
    ----------
    bank : Bank
    tuning : MatchTuning
    """

    def __init__(self, bank: Bank, tuning: MatchTuning = MatchTuning()) -> None:
        self.bank = bank
        self.tuning = tuning
        self._search = SubspaceSearch(bank.coefficients.reshape(-1, bank.coefficients.shape[-1]))
        self._views = ExemplarViews(np.arange(bank.poses), bank.view_quats, bank.view_origins)
        self._renderer = ExemplarRenderer(bank)
        self._upright = UprightExemplars(bank)
        self._proposed = ProposedExemplars(bank)

    def find(self, person: PersonView, scale: float | None) -> tuple[float, ScoredExemplars]:
        """Return the size whose exemplars agree best, and those, ranked.

        Parameters
        ----------
        person : PersonView
        scale : float or None
            Size of the body, relative to the bank's. Unknown, a few are tried, with fewer exemplars at each:
            near that of the measured joints, or over the whole range.
        """
        count = self.tuning.shortlist
        if scale is None:
            scales, count = _first_sizes(self._proposed.size(person.measured)), max(4, count // 4)
        else:
            scales = [scale]
        coarse, fine = person.thinned(_ROUGH_M), person.thinned(_FINE_M)
        shortlists = [(s, self._shortlist(person, s, count)) for s in scales]
        tried = [(s, self._renderer.compare(placed, s, coarse)) for s, placed in shortlists]
        scale, rough = min(tried, key=lambda t: float(t[1].scores.min()))
        there = rough.take(rough.ranking()[:_FINALISTS])
        # a correction from few pixels is only tried
        best = better(*(self._renderer.compare(p, scale, fine) for p in (there, there.moved())))
        return scale, best.take(best.ranking())

    def pose(self, placed: ScoredExemplars, row: int, scale: float) -> BodyPose:
        """Return the pose of one placed exemplar in the camera frame."""
        rotations = placed.rotations[row] @ self.bank.rotations(int(placed.exemplars[row]))
        return BodyPose(rotations, placed.translations[row], scale)

    def _shortlist(self, person: PersonView, scale: float, count: int) -> ScoredExemplars:
        """Return the exemplars nearest to the measured joints, or to the cloud in the subspace, placed."""
        if (proposed := self._proposed.find(person.measured, scale)) is not None:
            return proposed
        points, upright = person.points, self._upright
        axes = AXES[self.bank.view_scheme](points)
        found = []
        for a in axes:
            descriptor = self.bank.components @ (
                describe(points, a, scale).astype(np.float32) - self.bank.mean
            )
            found.append((self._views, self._search.find(descriptor, max(1, count // len(axes))), a))
        if person.is_cut_below:
            found.append((upright.views, upright.all, head_axes(points, scale)))
        return join([place_exemplars(*one, scale) for one in found])

    def keep_different(self, placed: ScoredExemplars, *, is_measured: bool) -> tuple[Candidate, ...]:
        """Return the best few candidates with different poses, more of them without measured joints."""
        most = self.tuning.keep if is_measured else self.tuning.keep_unmeasured
        return tuple(
            Candidate(
                exemplar=int(placed.exemplars[k]),
                view=int(placed.views[k]),
                rotation=placed.rotations[k],
                translation=placed.translations[k],
                distance=float(placed.distances[k]),
                score=float(placed.scores[k]),
            )
            for k in keep_different(placed.nodes, _SAME_POSE_M, most)
        )


def _first_sizes(measured: float | None) -> list[float]:
    """Return the sizes that are compared first."""
    sizes = SCALES[1::3]
    if measured is None:
        return sizes.tolist()
    nearest = int(np.argmin(np.abs(np.log(sizes / measured))))
    return sizes[max(0, nearest - 1) : nearest + 2].tolist()
