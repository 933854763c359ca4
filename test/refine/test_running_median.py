"""Running medians: NumPy's, of numbers that count alike; weighted, forgotten and bounded otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.refine.running_median import Bins, forget

BINS = Bins(1, -1.0, 0.01, 200)


def gathered(values, weights=None):
    bins = BINS._replace(rows=values.shape[1])
    histogram = bins.empty()
    for k, row in enumerate(values):
        histogram = bins.add(histogram, row, np.ones(len(row)) if weights is None else weights[k])
    return histogram


def medians(histogram):
    return BINS._replace(rows=len(histogram.total)).medians(histogram)


def test_it_is_the_median():
    values = np.random.default_rng(0).normal([0.0, 0.3, -0.2], 0.1, (301, 3))
    median = gathered(values)
    np.testing.assert_allclose(medians(median), np.median(values, axis=0), atol=0.01)
    np.testing.assert_array_equal(median.total, 301.0)


def test_weights_count():
    values = np.repeat([[0.1], [0.5]], 10, axis=0)
    assert medians(gathered(values, np.repeat([[3.0], [1.0]], 10, axis=0)))[0] == pytest.approx(0.1, abs=0.01)
    assert medians(gathered(values, np.repeat([[1.0], [3.0]], 10, axis=0)))[0] == pytest.approx(0.5, abs=0.01)


def test_earlier_values_are_forgotten():
    median = gathered(np.full((20, 1), 0.1))
    assert medians(median)[0] == pytest.approx(0.1, abs=0.01)
    for _ in range(20):
        median = BINS.add(forget(median, 0.8), np.array([0.6]), np.ones(1))
    assert medians(median)[0] == pytest.approx(0.6, abs=0.01)
    assert median.total[0] == pytest.approx(5.0, abs=0.3)


def test_what_lies_outside_counts_at_the_end():
    values = np.array([[-1e6], [1e6], [1e6], [1e6], [0.0]])
    assert medians(gathered(values))[0] == pytest.approx(1.0, abs=0.02)
