"""Who is served where time is short."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.track.time_budget import TimeBudget


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def persons():
    """Three people at 3, 4 and 5 metres, the farthest first."""
    depth = np.full((syn.CAMERA.height, syn.CAMERA.width), np.inf)
    layers = []
    for k, z in enumerate((5.0, 4.0, 3.0)):
        layer = depth.copy()
        layer[20:60, 20 + 40 * k : 50 + 40 * k] = z
        layers.append(layer)
    return syn.to_people(*layers).persons


def serve(budget, persons, clock, seconds):
    served = []
    for person in budget.take(persons):
        served.append(float(np.median(person.points[:, 2])))
        clock.now += seconds
    return served


def test_without_a_budget_all_in_their_order(persons):
    clock = Clock()
    assert serve(TimeBudget(clock), persons, clock, 100.0) == [5.0, 4.0, 3.0]


def test_the_nearest_first_and_then_who_was_left_out(persons):
    clock = Clock()
    budget = TimeBudget(clock)
    budget.limit_s = 1.0
    assert serve(budget, persons, clock, 0.6) == [3.0, 4.0]
    assert budget.left_out == 1
    assert serve(budget, persons, clock, 0.6) == [5.0, 3.0]
    assert serve(budget, persons, clock, 2.0) == [4.0]
    assert budget.left_out == 4
    assert serve(budget, persons, clock, 0.1) == [3.0, 5.0, 4.0]
