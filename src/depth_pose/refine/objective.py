r"""One score for every pose of a person: disagreement with the depth, the measured joints and the prior.

.. math:: s = d + w_a\, a + w_o\, \min(1, a)\, o

with the disagreement :math:`d` of rendered and observed depth, 0 to 1 (`depth_pose.body.rendered_depth`), the
mean distance :math:`a` of the joints from the measured ones in standard deviations, and the excess :math:`o`
of the pose prior (`depth_pose.refine.pose_prior`). The prior covers what measurements leave open: near them,
an unusual pose costs less; without a measurement it counts in full. The same score compares and chooses
poses in every stage, and for several cameras; the matcher ranks exemplars by its first term.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.bank import Bank
from depth_pose.body.pose import Fitted, FittedBody
from depth_pose.refine import _score_kernels as kernels
from depth_pose.refine.pose_prior import PosePrior, usual_joints
from depth_pose.track.person_view import PersonView


class Weights(NamedTuple):
    """Weights of the terms, relative to the depth term.

    Attributes
    ----------
    proposal_error : float
        Of each standard deviation from the measured joints; .06 keeps a leg that kneels in a wrong place, .09
        and .16 are as good.
    prior_excess : float
        Of each standard deviation above the usual.
    """

    proposal_error: float = 0.12
    prior_excess: float = 0.2


WEIGHTS = Weights()

_UNMEASURED = np.zeros((0, 3), np.float32), np.zeros((0, 2), np.float32)
"""Places and deviations of nobody's joints."""


class Score(NamedTuple):
    """A pose's score and its terms; lower is better.

    Attributes
    ----------
    total : float
    depth : float
        Disagreement with the depth image, 0 to 1.
    mean_depth_error : float
        Mean depth difference where body and person overlap, metres; not part of the total.
    proposal_error : float
        Mean distance of the joints from the measured ones, standard deviations; 0 without.
    prior_excess : float
        Excess of the pose prior, standard deviations; less where the pose is near the measured joints.
    """

    total: float
    depth: float
    mean_depth_error: float
    proposal_error: float
    prior_excess: float


class Objective:
    """Scores fitted bodies.

    Parameters
    ----------
    bank : Bank
        Its poses are the usual ones.
    weights : Weights

    Attributes
    ----------
    usual : (N, 19, 3) float64
        `usual_joints` of the bank.
    """

    def __init__(self, bank: Bank, weights: Weights = WEIGHTS) -> None:
        self.usual = usual_joints(bank)
        self._faces, self._weights = bank.body.faces, weights
        self._prior = PosePrior(self.usual)

    def criteria(self, person: PersonView) -> kernels.Criteria:
        """Return what the poses of one view are scored by."""
        measured, prior = person.found.measured, self._prior
        places, sigmas = (measured.places, measured.sigma) if measured is not None else _UNMEASURED
        return kernels.Criteria(person.coarse, places, sigmas, prior.mean, prior.whiten, *self._weights)

    def score(self, person: PersonView, body: FittedBody) -> Score:
        """Score a body in the camera frame of one view."""
        score = np.empty(len(Score._fields))
        criteria, scale = self.criteria(person), body.pose.scale
        kernels.score_body(criteria, body.vertices, self._faces, body.nodes, scale, score)
        return Score(*score.tolist())

    def pose_distance(self, fitted: Fitted) -> float:
        """Compute the distance of a fitted pose from the bank's mean, in standard deviations."""
        return self._prior.distance(fitted.nodes, fitted.pose.scale)

    def score_views(
        self, persons: Sequence[PersonView], bodies: Sequence[FittedBody], shares: NDArray[np.float64]
    ) -> Score:
        """Score a body seen by several cameras: the mean of its scores, weighted by ``shares`` (V,)."""
        scores = [self.score(person, body) for person, body in zip(persons, bodies, strict=True)]
        return Score._make(float(shares @ column) for column in zip(*scores, strict=True))
