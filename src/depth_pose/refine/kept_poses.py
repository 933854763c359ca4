"""Poses kept from frame to frame, and the choice of the answer among them and fresh fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.body.rendered_depth import Comparison
from depth_pose.core.skeleton import JOINT_NODES

_LEAD = 0.04
"""Score advantage, summed over consecutive frames, after which a different fresh pose becomes the answer."""

_SAME_M = 0.05
"""Poses with a mean joint distance below this (m) are the same; set by hand."""

_DIFFERS_M = 0.06
"""A pose joins the beam if some joint is this far (m) from that of each better pose."""

_HOPELESS = 0.08
"""Score above the answer's at which a pose leaves the beam; set by hand."""

AWAY_WEIGHT = 0.12
"""Weight in the score of the mean distance of joints from their proposals (`from_proposals`); .06 keeps a leg
that kneels in a wrong place, .09 and .16 are as good."""

_ODD_WEIGHT = 0.2
"""Weight in the score of each standard deviation above the usual (`PosePrior.excess`)."""


@dataclass(frozen=True)
class ScoredFit:
    """A fitted body and the terms of its score.

    Attributes
    ----------
    body : FittedBody
    comparison : Comparison
        Disagreement with the depth image.
    away : float
        Mean distance of the joints from their proposals, standard deviations.
    odd : float
        Excess of the pose prior, standard deviations; less where the pose is near its proposals.
    """

    body: FittedBody
    comparison: Comparison
    away: float
    odd: float

    @property
    def score(self) -> float:
        """Return the sum of rendered-depth disagreement, distance from proposals and pose prior."""
        return self.comparison.score + AWAY_WEIGHT * self.away + _ODD_WEIGHT * self.odd


@dataclass
class KeptPoses:
    """Start of a person's next fit.

    Attributes
    ----------
    beam : tuple of BodyPose
        The answer, and the next best poses that differ from it and from one another.
    turn : int
        Number of the frame; the groups are searched for limbs in turn.
    lead : float
        Score advantage of a different pose that was not the answer, summed over the last frames.
    tried : tuple of int
        Exemplars of the last match.
    """

    beam: tuple[BodyPose, ...] = ()
    turn: int = 0
    lead: float = 0.0
    tried: tuple[int, ...] = ()


def choose_answer(
    kept: KeptPoses, fresh: ScoredFit | None, old: ScoredFit | None = None, *others: ScoredFit | None
) -> ScoredFit:
    """Choose between fits from fresh and kept starts; a pose far from the previous one has to persist.

    Of two distant poses with similar agreement the kept one is right more often: it is supported by many
    frames, the fresh one by a single score.

    Parameters
    ----------
    kept : KeptPoses
        Its `lead` is updated.
    fresh, old : ScoredFit or None
        Fits from the candidates and from the previous answer; None if not finished.
    *others : ScoredFit or None
        Fits from the other kept poses.

    Returns
    -------
    ScoredFit
    """
    before, kept.lead = kept.lead, 0.0
    rival = min((pose for pose in (fresh, *others) if pose is not None), key=by_score, default=None)
    if rival is None or old is None:
        best = rival or old
        assert best is not None, "the best side is always finished"
        return best
    better = old.score - rival.score
    if better <= 0.0 or joint_gaps(rival, old).mean() < _SAME_M:
        return rival if better > 0.0 else old
    if before + better > _LEAD:
        return rival
    kept.lead = before + better
    return old


def keep_differing(best: ScoredFit, sides: list[ScoredFit], most: int) -> tuple[BodyPose, ...]:
    """Return at most ``most`` poses: the answer, and the best that differ from it and from one another."""
    beam = [best]
    for side in sorted(sides, key=by_score):
        if len(beam) >= most or side.score > best.score + _HOPELESS:
            break
        if all(joint_gaps(side, other).max() > _DIFFERS_M for other in beam):
            beam.append(side)
    return tuple(pose.body.pose for pose in beam)


def joint_gaps(one: ScoredFit, other: ScoredFit) -> NDArray[np.float64]:
    """Compute the distances (J,) between the joints of two poses, metres."""
    return np.asarray(np.linalg.norm(one.body.nodes[JOINT_NODES] - other.body.nodes[JOINT_NODES], axis=1))


def by_score(fitted: ScoredFit) -> float:
    """Return the score, as a key for sorting."""
    return fitted.score
