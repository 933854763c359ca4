"""Exemplars of the bank for one person at one size, placed, compared and ranked (Sec. 5).

The cloud is transformed to canonical axes, drawn as a small depth image, projected into the bank's PCA
subspace, and compared with every view of every exemplar there (Ye et al. eq. 6, exact search). The paper
takes the nearest one. Here the nearest few dozen, and those nearest to the measured joints, are posed, placed
at the input and rendered as small images, and the best of them as larger ones. The disagreement of rendered
and observed depth, the first term of `depth_pose.refine.objective`, ranks them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.bank.canonical import describe
from depth_pose.bank.views import AXES
from depth_pose.body.pose import BodyPose
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINT_NODES, NODE_INDEX, NODES
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

_CORRECTED = 8
"""Number of the best of them that are corrected once more."""

_NEARLY = 0.04
"""Score difference below which a best match that faces the other way is kept, too."""

_LEFT, _RIGHT = ([NODE_INDEX[f"{side}_{n}"] for n in ("shoulder", "hip")] for side in ("left", "right"))

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
        """Search with each of the input's axes at one size, and compare all results coarsely.

        Parameters
        ----------
        person : PersonView
        scale : float
            Size of the body, relative to the bank's.
        shortlist : int
            Maximum number of results of the search.

        Returns
        -------
        Placed
            Not ranked.
        """
        axes = AXES[self.bank.view_scheme](person.points)
        share = max(1, shortlist // len(axes))
        parts = []
        for a in axes:
            descriptor = describe(person.points, a, scale).astype(np.float32)
            nearest = self._search.find(self.bank.components @ (descriptor - self.bank.mean), share)
            parts.append(place_exemplars(self._views, nearest, a, scale))
        if person.is_cut_below:
            hung, upright = head_axes(person.points, scale), self._upright
            parts.append(place_exemplars(upright.views, upright.all, hung, scale))
        if (proposed := self._proposed.find(person.measured, scale)) is not None:
            parts.append(proposed)
        return self._renderer.compare(join(parts), scale, person.thinned(_ROUGH_M))

    def compare_finely(self, person: PersonView, scale: float, rough: Placed) -> Placed:
        """Compare the best of the shortlist in a finer image, and sort them by score."""
        image = person.thinned(_FINE_M)
        ranking = rough.ranking()
        there = rough.take(_with_facing(ranking, _FINALISTS, _faces_alike(rough, person.measured)))
        # a correction from few pixels is only tried
        pairs = (self._renderer.compare(p, scale, image) for p in (there, there.moved()))
        compared = better(*pairs)
        ranking = compared.ranking()
        best = compared.take(_with_facing(ranking, _CORRECTED, _faces_alike(compared, person.measured)))
        best = better(best, self._renderer.compare(best.moved(), scale, image))
        return best.take(best.ranking())

    def keep_different(self, placed: Placed, measured: JointMeasurement | None) -> tuple[Candidate, ...]:
        """Return the best few candidates with different poses, some of them facing as may be true.

        From behind people look much as from the front. Where the bank has no near pose, one that faces the
        wrong way may agree as well as one that faces the right way: then one of each kind is kept, and the
        fit decides. One faces as the measured joints do.
        """
        rows = keep_different(placed.nodes, _SAME_POSE_M, len(placed.scores))
        across, is_close = _across(placed.nodes), placed.scores < placed.scores[0] + _NEARLY
        is_turned = is_close & (across @ across[0] < 0.0)
        kept = _with_facing(rows, self.tuning.keep, is_turned)
        others = rows[~np.isin(rows, kept)]
        kept = _with_facing(np.append(kept, others), self.tuning.keep, _faces_alike(placed, measured))
        return tuple(
            Candidate(
                exemplar=int(placed.exemplars[k]),
                view=int(placed.views[k]),
                rotation=placed.rotations[k],
                translation=placed.translations[k],
                distance=float(placed.distances[k]),
                score=float(placed.scores[k]),
            )
            for k in kept
        )


def _faces_alike(placed: Placed, measured: JointMeasurement | None) -> NDArray[np.bool_]:
    """Return which exemplars (K,) face as the proposed joints do; all without proposals."""
    if measured is None:
        return np.ones(len(placed.scores), np.bool_)
    proposed = np.empty((len(NODES), 3))
    proposed[JOINT_NODES] = measured.places
    return np.asarray(_across(placed.nodes) @ _across(proposed[None])[0] > 0.0)


def _across(nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (K, 3) to the persons' left."""
    return np.asarray(nodes[:, _LEFT].sum(axis=1) - nodes[:, _RIGHT].sum(axis=1))


def _with_facing(rows: NDArray[np.int64], most: int, alike: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the first ``most`` rows; if none faces alike, the last gives way to the first that does."""
    taken, others = rows[:most], rows[most:]
    if alike[taken].any() or not alike[others].any():
        return taken
    return np.append(taken[:-1], others[alike[others]][0])
