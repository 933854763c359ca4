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
from depth_pose.core.types import Candidate
from depth_pose.match._match_kernels import keep_different
from depth_pose.match.placing import (
    ExemplarRenderer,
    ExemplarViews,
    Placed,
    better,
    join,
    place_exemplars,
)
from depth_pose.match.proposed_exemplars import ProposedExemplars
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

    def measured_size(self, person: PersonView) -> float | None:
        """Estimate a person's size from the measured joints; None without."""
        return self._proposed.size(person.measured)

    def find(self, person: PersonView, scale: float) -> Placed:
        """Return the exemplars that agree best at a size, ranked."""
        return self.compare_finely(person, scale, self.compare_roughly(person, scale, self.tuning.shortlist))

    def pose(self, placed: Placed, row: int, scale: float) -> BodyPose:
        """Return the pose of one placed exemplar in the camera frame."""
        rotations = placed.rotations[row] @ self.bank.rotations(int(placed.exemplars[row]))
        return BodyPose(rotations, placed.translations[row], scale)

    def compare_roughly(self, person: PersonView, scale: float, shortlist: int) -> Placed:
        """Search at one size, by joints or with each of the input's axes, and compare all results coarsely.

        Parameters
        ----------
        person : PersonView
        scale : float
            Size of the body, relative to the bank's.
        shortlist : int
            Maximum number of results of the search with axes.

        Returns
        -------
        Placed
            Not ranked.
        """
        placed = self._proposed.find(person.measured, scale)
        if placed is None:
            placed = self._find_by_cloud(person, scale, shortlist)
        return self._renderer.compare(placed, scale, person.thinned(_ROUGH_M))

    def _find_by_cloud(self, person: PersonView, scale: float, shortlist: int) -> Placed:
        """Return the exemplars whose view is nearest to the input's in the subspace, placed."""
        axes, parts = AXES[self.bank.view_scheme](person.points), []
        share = max(1, shortlist // len(axes))
        for a in axes:
            descriptor = describe(person.points, a, scale).astype(np.float32)
            nearest = self._search.find(self.bank.components @ (descriptor - self.bank.mean), share)
            parts.append(place_exemplars(self._views, nearest, a, scale))
        if person.is_cut_below:
            hung, upright = head_axes(person.points, scale), self._upright
            parts.append(place_exemplars(upright.views, upright.all, hung, scale))
        return join(parts)

    def compare_finely(self, person: PersonView, scale: float, rough: Placed) -> Placed:
        """Compare the best of the shortlist in a finer image, and sort them by score."""
        image = person.thinned(_FINE_M)
        there = rough.take(rough.ranking()[:_FINALISTS])
        # a correction from few pixels is only tried
        best = better(*(self._renderer.compare(p, scale, image) for p in (there, there.moved())))
        return best.take(best.ranking())

    def keep_different(self, placed: Placed) -> tuple[Candidate, ...]:
        """Return the best few candidates with different poses."""
        return tuple(
            Candidate(
                exemplar=int(placed.exemplars[k]),
                view=int(placed.views[k]),
                rotation=placed.rotations[k],
                translation=placed.translations[k],
                distance=float(placed.distances[k]),
                score=float(placed.scores[k]),
            )
            for k in keep_different(placed.nodes, _SAME_POSE_M, self.tuning.keep)
        )
