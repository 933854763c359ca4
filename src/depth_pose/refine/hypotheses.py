"""Hypotheses: poses from which a fit may start, with their source; and scored fits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.refine.objective import Score

Source = Literal["previous", "carried", "exemplar", "joints", "limb", "turned", "camera"]
"""Sources of a pose: the previous answer; another pose carried over from the previous frame, or the
last good body after a failure; an exemplar of the bank; limbs turned to measured joints; limbs of other
exemplars; the answer, facing the other way; the answer of one camera of several."""


class Hypothesis(NamedTuple):
    """A pose in the frame of the fit, from which a fit starts, and its source."""

    pose: BodyPose
    source: Source


@dataclass(frozen=True)
class ScoredFit:
    """A fitted body and its score.

    Attributes
    ----------
    body : FittedBody
    terms : Score
    source : Source
        Of the start; limbs that were exchanged later do not change it.
    is_finished : bool
        Whether it was fitted finely.
    """

    body: FittedBody
    terms: Score
    source: Source
    is_finished: bool = False

    @property
    def score(self) -> float:
        """Return the total score; lower is better."""
        return self.terms.total


def by_score(fitted: ScoredFit) -> float:
    """Return the score, as a key for sorting."""
    return fitted.score


def joint_gaps(one: ScoredFit, other: ScoredFit) -> NDArray[np.float64]:
    """Compute the distances (19,) between the joints of two poses, metres."""
    return np.asarray(np.linalg.norm(one.body.nodes[JOINT_NODES] - other.body.nodes[JOINT_NODES], axis=1))
