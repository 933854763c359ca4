"""The solver's order of work, with fits that only count: what is glanced at, fitted and finished."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.skeleton import NODES
from depth_pose.refine.hypotheses import Hypothesis
from depth_pose.refine.objective import Score
from depth_pose.refine.solver import Effort, Problem, solve


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
        return Problem(self, lambda b: Score(b.pose.scale, b.pose.scale, 0.0, self.away, 0.0), self.vary)


FRESH = [start(0.5), start(0.3, aside=0.2), start(0.4)]
PREVIOUS = start(0.2, "previous")


@pytest.mark.parametrize(
    ("starts", "effort", "away", "work"),
    [
        (FRESH, Effort(1), 0.0, {"glance": 3, "rough": 1, "fine": 1, "vary": 1}),
        (FRESH, Effort(1, roughs=2), 0.0, {"glance": 3, "rough": 2, "fine": 1, "vary": 1}),
        ([PREVIOUS], Effort(1), 0.0, {"rough": 1, "fine": 1}),
        ([PREVIOUS], Effort(4), 0.0, {"rough": 1, "fine": 1, "vary": 1}),
        ([PREVIOUS, *FRESH], Effort(1), 0.0, {"glance": 3, "rough": 2, "fine": 1}),
        ([PREVIOUS, *FRESH], Effort(1, is_settled=True), 0.0, {"rough": 1, "fine": 1}),
        (
            [PREVIOUS, *FRESH],
            Effort(1, is_settled=True),
            0.9,
            {"glance": 3, "rough": 2, "fine": 1, "vary": 1},
        ),
        ([start(0.28, "previous"), *FRESH], Effort(1), 0.0, {"glance": 3, "rough": 2, "fine": 2}),
    ],
)
def test_work_follows_doubt(starts, effort, away, work):
    fits = Counted(away)
    solve(starts, fits.problem, effort)
    assert fits.done == work


def test_the_best_fresh_start_comes_first_and_only_good_fits_are_finished():
    fresh, previous = solve([PREVIOUS, *FRESH], Counted().problem, Effort(1))
    assert (fresh.score, fresh.source, fresh.is_finished) == (0.3, "exemplar", False)
    assert (previous.score, previous.source, previous.is_finished) == (0.2, "previous", True)


@pytest.mark.parametrize(("score", "rounds"), [(0.1, 4), (0.35, 1)])
def test_limbs_are_exchanged_while_that_improves(score, rounds):
    """A variant that is always the same improves once; then nothing does."""
    fits = Counted(varied=[start(score, "limb")])
    (best,) = solve(FRESH, fits.problem, Effort(1))
    assert best.score == min(score, 0.3)
    assert best.source == "exemplar"
    assert fits.done["vary"] == (2 if score < 0.3 else 1) <= rounds
