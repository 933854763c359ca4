"""Choosing and thinning by distance against slow twins."""

import numpy as np
import pytest

from depth_pose.core.farthest_points import farthest_rows, keep_apart


def test_keeping_apart_against_its_slow_twin() -> None:
    rows = np.random.default_rng(11).normal(size=(200, 5)).astype(np.float32)
    kept: list[int] = []
    for i in range(len(rows)):
        if all(((rows[i] - rows[j]) ** 2).sum() >= 1.0 for j in kept):
            kept.append(i)
    assert np.flatnonzero(keep_apart(rows, np.float32(1.0))).tolist() == kept


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_farthest_choice_against_its_slow_twin(dtype) -> None:
    rng = np.random.default_rng(12)
    rows = rng.normal(size=(150, 9)).astype(dtype)
    images, weights = -rows, rng.uniform(0.5, 2, 150).astype(dtype)
    nearest, chosen = np.full(150, np.inf), [3]
    for _ in range(39):
        for point in (rows[chosen[-1]], images[chosen[-1]]):
            nearest = np.minimum(nearest, ((rows - point) ** 2).sum(1))
        value = nearest * weights
        value[chosen] = -1
        chosen.append(int(np.argmax(value)))
    assert farthest_rows(rows, 40, 3, images, weights).tolist() == chosen


def test_farthest_rows_are_spread_from_the_middle_on() -> None:
    points = np.random.default_rng(7).uniform(-1.0, 1.0, (400, 3)) * [1.0, 1.0, 0.01]
    chosen = farthest_rows(points, 20)
    assert np.linalg.norm(points[chosen[0]]) < 0.2
    gaps = np.linalg.norm(points[chosen][:, None] - points[chosen], axis=2) + 9 * np.eye(20)
    assert gaps.min() > 0.3
    assert sorted(farthest_rows(points[:5], 20).tolist()) == [0, 1, 2, 3, 4]
