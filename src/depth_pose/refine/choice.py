"""Choose the answer among the fits, and the poses that continue in the next frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from depth_pose.body.pose import BodyPose
from depth_pose.refine.hypotheses import ScoredFit, by_score, joint_gaps

_LEAD = 0.04
"""Score advantage, summed over consecutive frames, after which a different pose becomes the answer."""

_SAME_M = 0.05
"""Poses with a mean joint distance below this (m) are the same; set by hand."""

_DIFFERS_M = 0.06
"""Minimum distance (m) of some joint from every better pose, for a pose to be kept beside the answer."""

_HOPELESS = 0.08
"""Score excess over the answer above which a pose is not kept; set by hand."""


class Choice(NamedTuple):
    """The chosen fit, and the lead of a different one that was not chosen (`depth_pose.track.state`)."""

    best: ScoredFit
    lead: float


def choose(fits: Sequence[ScoredFit], lead: float = 0.0) -> Choice:
    """Choose the answer; a pose far from the previous answer has to be better by a margin, or persist.

    Of two distant poses with similar agreement the previous one is right more often: it is supported by many
    frames, the other by a single score.

    Parameters
    ----------
    fits : sequence of ScoredFit
        At least one that is finished; others are left out.
    lead : float
        Of the frame before.
    """
    finished = [fit for fit in fits if fit.is_finished]
    old = next((fit for fit in finished if fit.source == "previous"), None)
    rival = min((fit for fit in finished if fit is not old), key=by_score, default=None)
    if rival is None or old is None:
        best = rival or old
        assert best is not None, "the best fit is always finished"
        return Choice(best, 0.0)
    better = old.score - rival.score
    if better <= 0.0:
        return Choice(old, 0.0)
    if joint_gaps(rival, old).mean() < _SAME_M or lead + better > _LEAD:
        return Choice(rival, 0.0)
    return Choice(old, lead + better)


def keep_differing(best: ScoredFit, fits: Sequence[ScoredFit], most: int) -> tuple[BodyPose, ...]:
    """Return at most ``most`` poses: the answer, and the best that differ from it and from one another."""
    kept = [best]
    for fit in sorted(fits, key=by_score):
        if len(kept) >= most or fit.score > best.score + _HOPELESS:
            break
        if all(joint_gaps(fit, other).max() > _DIFFERS_M for other in kept):
            kept.append(fit)
    return tuple(fit.body.pose for fit in kept)
