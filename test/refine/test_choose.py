"""Which fit is the answer, and which poses are followed: tables of scores and distances."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.skeleton import NODES
from depth_pose.refine.choice import choose, keep_differing
from depth_pose.refine.hypotheses import ScoredFit
from depth_pose.refine.objective import Score


def fit(score, aside=0.0, source="exemplar", *, is_finished=True):
    """A body that stands ``aside`` metres to the right, with a score."""
    nodes = np.zeros((len(NODES), 3)) + [aside, 0.0, 3.0]
    body = FittedBody(BodyPose(np.zeros((len(NODES), 3, 3)), nodes[0], 1.0), np.zeros((0, 3)), nodes)
    return ScoredFit(body, Score(score, score, 0.0, 0.0, 0.0), source, is_finished)


@pytest.mark.parametrize(
    ("previous", "fresh", "gap_m", "lead", "winner", "lead_after"),
    [
        (0.30, 0.29, 0.02, 0.00, "exemplar", 0.00),  # near: the better one at once
        (0.30, 0.31, 0.02, 0.00, "previous", 0.00),
        (0.30, 0.27, 0.10, 0.00, "previous", 0.03),  # far: it has to persist
        (0.30, 0.27, 0.10, 0.03, "exemplar", 0.00),
        (0.30, 0.31, 0.10, 0.03, "previous", 0.00),  # once worse, it starts anew
        (0.30, 0.20, 0.10, 0.00, "exemplar", 0.00),  # or be better by the margin
        (0.30, None, 0.00, 0.03, "previous", 0.00),
        (None, 0.90, 0.10, 0.03, "exemplar", 0.00),
    ],
)
def test_the_winner_by_score_gap_and_lead(previous, fresh, gap_m, lead, winner, lead_after):
    fits = [] if fresh is None else [fit(fresh, gap_m)]
    fits += [] if previous is None else [fit(previous, source="previous")]
    choice = choose(fits, lead)
    assert choice.best.source == winner
    assert choice.lead == pytest.approx(lead_after)


@pytest.mark.parametrize(
    ("fresh", "carried", "winner"),
    [(0.28, 0.20, "carried"), (0.20, 0.28, "exemplar"), (0.31, 0.31, "previous")],
)
def test_whatever_was_carried_beside_the_answer_may_answer_as_a_fresh_pose_may(fresh, carried, winner):
    fits = [fit(fresh, 0.1), fit(0.30, source="previous"), fit(carried, -0.1, "carried")]
    assert choose(fits).best.source == winner


def test_what_is_not_finished_does_not_answer():
    fits = [fit(0.1, 0.1, is_finished=False), fit(0.3, source="previous")]
    assert choose(fits, 0.03) == (fits[1], 0.0)


@pytest.mark.parametrize(
    ("most", "followed"), [(1, [0.0]), (2, [0.0, -0.1]), (3, [0.0, -0.1, 0.1]), (5, [0.0, -0.1, 0.1])]
)
def test_the_best_poses_that_differ_are_followed_beside_the_answer(most, followed):
    answer = fit(0.20)
    fits = [fit(0.21, 0.03), fit(0.23, 0.1), answer, fit(0.22, -0.1), fit(0.5, 0.2)]
    assert [pose.root[0] for pose in keep_differing(answer, fits, most)] == followed
