"""The solver: from hypotheses of a person's pose in one frame to the answer, by one score.

The pose of the previous frame is fitted at once. While it lies near the measured joints the person is calm,
and nothing else is tried: work follows doubt. Otherwise the fresh starts that are best after a glance are
fitted as well, and the best fits again with limbs turned to the measured joints. A pose that has converged
over many frames agrees better than any unfitted one even if it is wrong, so only fits are compared with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Literal, NamedTuple, Protocol

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.refine.objective import Score

Source = Literal["previous", "carried", "exemplar", "joints", "camera"]
"""Sources of a pose: the previous answer; the last body, carried over after a failure; an exemplar of the
bank; limbs turned to measured joints; one camera's answer of several."""

_ROUGHS, _UNMEASURED_ROUGHS = 2, 4
"""Number of fresh starts, the best after a glance, that are fitted roughly: with measured joints (4 err as
much; with 1 fewer people in rooms are believed), and without, where only the fit tells the facing."""

_CALM = 0.5
"""Mean distance of the previous pose from the measured joints (standard deviations) below which nothing else
is tried; swept from .35 to .8: accuracy falls and speed rises throughout."""

_NEAR = 0.02
"""Limbs of a fit are turned if its score is at most this much above the best one's. With 0 the error of
people below a ceiling rises by 4 %; without a limit it stays the same."""

_BY_SCORE = attrgetter("terms.total")

_FOLLOWED = ("previous", "carried")
"""Sources of the starts from the previous frame."""


class Hypothesis(NamedTuple):
    """A pose in the frame of the fit, from which a fit starts, and its source."""

    pose: BodyPose
    source: Source


class FrameFit(Protocol):
    """Fits one build to one person in one frame, one start at a time."""

    def glance(self, start: BodyPose) -> FittedBody:
        """Run a short fit."""

    def rough(self, start: BodyPose) -> FittedBody:
        """Run a rough fit."""

    def finish(self, fitted: FittedBody) -> FittedBody:
        """Refine a rough fit."""


class ScoredFit(NamedTuple):
    """A fitted body, its score, and the source of its start."""

    body: FittedBody
    terms: Score
    source: Source

    @property
    def score(self) -> float:
        """Return the total score; lower is better."""
        return self.terms.total


class Problem(Protocol):
    """One person in one frame, seen by one camera or by several: what a solver needs to know."""

    def rough(self, start: Hypothesis) -> ScoredFit:
        """Run a rough fit, precise enough to choose between a few starts."""

    def best(self, starts: Sequence[Hypothesis], count: int) -> ScoredFit:
        """Return the best of the rough fits of the ``count`` starts that are best after a glance."""

    def fine(self, fitted: ScoredFit) -> ScoredFit:
        """Refine a rough fit to full precision."""

    def vary(self, body: FittedBody) -> list[Hypothesis]:
        """Return hypotheses with other limbs for a fitted body."""


@dataclass(frozen=True)
class SingleFits:
    """A problem whose fits run one after the other.

    Attributes
    ----------
    fit : FrameFit
        Fits one build of the body.
    score : callable
        Scores a fitted body (`depth_pose.refine.objective.Objective`).
    vary : callable
    """

    fit: FrameFit
    score: Callable[[FittedBody], Score]
    vary: Callable[[FittedBody], list[Hypothesis]] = lambda _: []

    def rough(self, start: Hypothesis) -> ScoredFit:
        """Run a rough fit."""
        return self._scored(self.fit.rough(start.pose), start.source)

    def best(self, starts: Sequence[Hypothesis], count: int) -> ScoredFit:
        """Return the best of the rough fits of the ``count`` starts that are best after a glance."""
        glances = [self._scored(self.fit.glance(start.pose), start.source) for start in starts]
        chosen = sorted(glances, key=_BY_SCORE)[:count]
        return min([self.rough(Hypothesis(g.body.pose, g.source)) for g in chosen], key=_BY_SCORE)

    def fine(self, fitted: ScoredFit) -> ScoredFit:
        """Refine a rough fit to full precision."""
        return self._scored(self.fit.finish(fitted.body), fitted.source)

    def _scored(self, body: FittedBody, source: Source) -> ScoredFit:
        return ScoredFit(body, self.score(body), source)


def solve(
    starts: Sequence[Hypothesis], problem: Problem, *, is_measured: bool, is_calm: bool = False
) -> ScoredFit:
    """Fit hypotheses roughly, and the one with the best score finely.

    Parameters
    ----------
    starts : sequence of Hypothesis
        At least one.
    problem : Problem
    is_measured : bool
        Whether there are measured joints, by which a person can be calm.
    is_calm : bool
        Whether hardly anything has moved since the person was measured: no other start is tried.
    """
    fits = [problem.rough(h) for h in starts if h.source in _FOLLOWED]
    if fits and (is_calm or (is_measured and fits[0].terms.proposal_error < _CALM)):
        return _finish(fits[0], problem)
    if fresh := [h for h in starts if h.source not in _FOLLOWED]:
        fits.append(problem.best(fresh, _ROUGHS if is_measured else _UNMEASURED_ROUGHS))
    limit = min(fit.score for fit in fits) + _NEAR
    fits = [_turn_limbs(fit, problem) for fit in fits if fit.score <= limit]
    return _finish(min(fits, key=_BY_SCORE), problem)


def _turn_limbs(fitted: ScoredFit, problem: Problem) -> ScoredFit:
    """Replace arms or legs if the fit improves."""
    starts = problem.vary(fitted.body)
    return min(fitted, problem.best(starts, 1), key=_BY_SCORE) if starts else fitted


def _finish(rough: ScoredFit, problem: Problem) -> ScoredFit:
    """Fit finely; keep the rough fit if it agrees better, for instance if the fine one lost an arm."""
    return min(problem.fine(rough), rough, key=_BY_SCORE)
