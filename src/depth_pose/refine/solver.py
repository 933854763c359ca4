"""The solver: from hypotheses of a person's pose in one frame to a few fitted and scored bodies.

Two groups of starts compete. Poses that are followed from the previous frame are fitted at once. Of all
others, the best after a glance is. Tracking alone loses arms and does not recover them; a pose that has
converged over many frames, however, agrees better than any unfitted one even if it is wrong, so each group is
fitted separately. Limbs are exchanged as long as the fit improves. Work follows doubt: a calm person gets one
start, and one limb search in a few frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.refine.body_fitter import FrameFit
from depth_pose.refine.hypotheses import Hypothesis, ScoredFit, Source, by_score, joint_gaps
from depth_pose.refine.objective import Score

_FIRST_ROUNDS = 4
"""Rounds of limb search while there is no previous pose to start from."""

_LIMBS_EVERY = 4
"""Frames from one limb search to the next for a person with a previous pose; the groups take turns."""

_DOUBTFUL = 0.5
"""Mean distance of a pose from its measured joints (standard deviations) above which limbs are searched in
every frame; chosen on development clips of .65, .55, .5 and .42."""

_NEARLY = 0.04
"""The worse group is also fitted finely if its score is at most this much higher."""

_SAME_M = 0.03
"""Minimum distance (m) of some joint from the better group's, for that second fine fit."""


class Effort(NamedTuple):
    """How much work is spent on a person in a frame.

    Attributes
    ----------
    number : int
        Number of the frame; the groups' limbs are searched in turn.
    is_settled : bool
        Whether the same fresh starts lost already to the pose that is followed.
    roughs : int
        Number of fresh starts, the best after a glance, that are fitted roughly.
    """

    number: int = 0
    is_settled: bool = False
    roughs: int = 1


@dataclass(frozen=True)
class Problem:
    """One person in one frame, seen by one camera or by several: what a solver needs to know.

    Attributes
    ----------
    fit : FrameFit
        Fits one build of the body.
    score : callable
        Scores a fitted body (`depth_pose.refine.objective.Objective`).
    vary : callable
        Returns hypotheses with other limbs for a fitted body.
    """

    fit: FrameFit
    score: Callable[[FittedBody], Score]
    vary: Callable[[FittedBody], list[Hypothesis]]

    def glance(self, start: Hypothesis) -> ScoredFit:
        """Run a short fit, precise enough to rank the starts."""
        return self._scored(self.fit.glance(start.pose), start.source)

    def rough(self, pose: BodyPose, source: Source) -> ScoredFit:
        """Run a rough fit, precise enough to choose between a few starts."""
        return self._scored(self.fit.rough(pose), source)

    def finish(self, rough: ScoredFit) -> ScoredFit:
        """Fit finely; keep the rough fit if it agrees better, for instance if the fine one lost an arm."""
        fine = self._scored(self.fit.finish(rough.body), rough.source)
        best = min(fine, rough, key=by_score)
        return ScoredFit(best.body, best.terms, best.source, is_finished=True)

    def _scored(self, body: FittedBody, source: Source) -> ScoredFit:
        return ScoredFit(body, self.score(body), source)


def solve(starts: Sequence[Hypothesis], problem: Problem, effort: Effort = Effort()) -> list[ScoredFit]:  # noqa: B008
    """Fit hypotheses: one fit for the fresh starts, one for each that is followed, the best ones finely.

    Parameters
    ----------
    starts : sequence of Hypothesis
        At least one.
    problem : Problem
    effort : Effort

    Returns
    -------
    list of ScoredFit
        The fresh one first; among them one that is finished.
    """
    followed = [problem.rough(*h) for h in starts if _is_followed(h)]
    fresh = [h for h in starts if not _is_followed(h)]
    is_calm = effort.is_settled and bool(followed) and followed[0].terms.away <= _DOUBTFUL
    groups = ([_fit_best(fresh, problem, effort.roughs)] if fresh and not is_calm else []) + followed
    if not followed:
        groups = [_exchange_limbs(group, problem, _FIRST_ROUNDS) for group in groups]
    elif effort.number % _LIMBS_EVERY == 0 or min(group.terms.away for group in groups) > _DOUBTFUL:
        turn = effort.number // _LIMBS_EVERY % len(groups)
        groups[turn] = _exchange_limbs(groups[turn], problem, 1)
    first = min(groups, key=by_score)
    return [problem.finish(g) if _is_worth_it(g, first) else g for g in groups]


def _is_followed(start: Hypothesis) -> bool:
    """Whether a start comes from the previous frame."""
    return start.source in ("previous", "carried")


def _fit_best(starts: Iterable[Hypothesis], problem: Problem, count: int = 1) -> ScoredFit:
    """Return the best of the rough fits of the ``count`` starts that are best after a glance."""
    glances = sorted((problem.glance(start) for start in starts), key=by_score)
    return min((problem.rough(g.body.pose, g.source) for g in glances[:count]), key=by_score)


def _exchange_limbs(fitted: ScoredFit, problem: Problem, rounds: int) -> ScoredFit:
    """Replace arms and legs as long as the fit improves."""
    for _ in range(rounds):
        starts = problem.vary(fitted.body)
        if not starts:
            break
        exchanged = _fit_best(starts, problem)
        if exchanged.score >= fitted.score:
            break
        fitted = ScoredFit(exchanged.body, exchanged.terms, fitted.source)
    return fitted


def _is_worth_it(fitted: ScoredFit, first: ScoredFit) -> bool:
    """Check whether a rough fit is worth a fine one, given the best one."""
    if fitted is first:
        return True
    return fitted.score <= first.score + _NEARLY and bool(joint_gaps(fitted, first).max() > _SAME_M)
