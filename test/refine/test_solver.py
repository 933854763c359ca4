"""The solver's order of work, with fits that only count: what is glanced at, fitted and finished."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.skeleton import NODES
from depth_pose.refine.objective import Score
from depth_pose.refine.solver import Hypothesis, SingleFits, solve


def start(score, source="exemplar", aside=0.0):
    """A pose whose score is kept in its size, ``aside`` metres to the right."""
    return Hypothesis(BodyPose(np.zeros((len(NODES), 3, 3)), np.array([aside, 0.0, 3.0]), score), source)


class Counted:
    """Fits that leave a pose as it is."""

    def __init__(self, away=0.0, varied=()):
        self.done, self.away, self.varied = Counter(), away, list(varied)

    def _fit(self, kind, pose):
        self.done[kind] += 1
        return FittedBody(pose, np.zeros((0, 3)), np.zeros((len(NODES), 3)) + pose.root)

    def glance(self, pose):
        return self._fit("glance", pose)

    def rough(self, pose):
        return self._fit("rough", pose)

    def finish(self, fitted):
        return self._fit("fine", fitted.pose)

    def vary(self, body):
        self.done["vary"] += 1
        return self.varied

    @property
    def problem(self):
        return SingleFits(self, lambda b: Score(b.pose.scale, b.pose.scale, 0.0, self.away, 0.0), self.vary)


FRESH = [start(0.5), start(0.3, aside=0.2), start(0.4)]
PREVIOUS = start(0.2, "previous")
CALM, DOUBTFUL = 0.4, 0.9


@pytest.mark.parametrize(
    ("starts", "away", "is_measured", "work"),
    [
        (FRESH, DOUBTFUL, True, {"glance": 3, "rough": 2, "fine": 1, "vary": 1}),
        ([PREVIOUS], CALM, True, {"rough": 1, "fine": 1}),
        ([PREVIOUS, *FRESH], CALM, True, {"rough": 1, "fine": 1}),
        ([PREVIOUS, *FRESH], DOUBTFUL, True, {"glance": 3, "rough": 3, "fine": 1, "vary": 1}),
        ([PREVIOUS, *FRESH], 0.0, False, {"glance": 3, "rough": 4, "fine": 1, "vary": 1}),
        ([PREVIOUS], DOUBTFUL, True, {"rough": 1, "fine": 1, "vary": 1}),
        ([start(0.285, "previous"), *FRESH], 0.0, False, {"glance": 3, "rough": 4, "fine": 1, "vary": 2}),
        ([start(0.28, "carried")], 0.0, False, {"rough": 1, "fine": 1, "vary": 1}),
    ],
)
def test_work_follows_doubt(starts, away, is_measured, work):
    fits = Counted(away)
    solve(starts, fits.problem, is_measured=is_measured)
    assert fits.done == work


@pytest.mark.parametrize(
    ("starts", "work"),
    [
        ([PREVIOUS, *FRESH], {"rough": 1, "fine": 1}),
        (FRESH, {"glance": 3, "rough": 2, "fine": 1, "vary": 1}),
    ],
)
def test_nothing_else_is_tried_of_who_has_not_moved(starts, work):
    fits = Counted(DOUBTFUL)
    solve(starts, fits.problem, is_measured=True, is_calm=True)
    assert fits.done == work


@pytest.mark.parametrize(
    ("previous", "fresh", "source"),
    [(0.2, 0.3, "previous"), (0.3, 0.2, "exemplar"), (0.3, 0.29, "exemplar"), (0.3, 0.3, "previous")],
)
def test_the_better_score_answers(previous, fresh, source):
    starts = [start(fresh, aside=0.2), start(previous, "previous")]
    best = solve(starts, Counted().problem, is_measured=False)
    assert (best.source, best.score) == (source, min(previous, fresh))


@pytest.mark.parametrize(("score", "source"), [(0.1, "joints"), (0.35, "exemplar")])
def test_limbs_are_turned_if_that_improves(score, source):
    fits = Counted(varied=[start(score, "joints")])
    best = solve(FRESH, fits.problem, is_measured=True)
    assert (best.score, best.source) == (min(score, 0.3), source)


def test_a_fine_fit_that_is_worse_than_the_rough_one_is_not_used():
    class Worse(Counted):
        def finish(self, fitted):
            return self._fit("fine", start(0.9).pose)

    best = solve(FRESH, Worse().problem, is_measured=True)
    assert best.score == 0.3
