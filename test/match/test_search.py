"""Exact search: every answer against all distances."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.match import _search_kernels as kernels
from depth_pose.match.search import SubspaceSearch


def twin(table, point, count):
    distances = np.linalg.norm(table.astype(float) - point.astype(float), axis=1)
    order = np.argsort(distances, kind="stable")[:count]
    return order, distances[order]


def clustered(rng, count, dimensions):
    """Entries in clumps, most of the variance in the first dimensions, as PCA gives them."""
    spread = 5.0 * 0.9 ** np.arange(dimensions)
    centres = rng.standard_normal((20, dimensions)) * spread
    noise = 0.3 * rng.standard_normal((count, dimensions)) * spread
    return (centres[rng.integers(0, 20, count)] + noise).astype(np.float32)


@pytest.mark.parametrize("count", [1, 10, 128, 700])
@pytest.mark.parametrize(("entries", "dimensions"), [(20_000, 48), (5_003, 48), (700, 30), (900, 9)])
def test_search_is_exact(entries, dimensions, count):
    rng = np.random.default_rng(entries + dimensions)
    table = clustered(rng, entries, dimensions)
    search = SubspaceSearch(table)
    for point in (*clustered(rng, 3, dimensions), table[7], np.full(dimensions, 30.0, np.float32)):
        found = search.find(point, count)
        expected, distances = twin(table, point, count)
        swapped = found.entries != expected  # only where two distances are equal but for rounding
        mine = np.linalg.norm(table[found.entries].astype(float) - point, axis=1)
        np.testing.assert_allclose(mine[swapped], distances[swapped], rtol=1e-6)
        assert len(np.unique(found.entries)) == len(expected)
        np.testing.assert_allclose(found.distances, distances, rtol=1e-4, atol=1e-4)


def test_equal_entries_come_in_their_order_and_no_more_than_there_are():
    table = np.repeat(np.eye(4, dtype=np.float32), 3, axis=0)
    found = SubspaceSearch(table).find(np.array([0.0, 1.0, 0.1, 0.0], np.float32), 99)
    assert len(found.entries) == 12
    assert found.entries[:6].tolist() == [3, 4, 5, 6, 7, 8]
    assert sorted(found.entries.tolist()) == list(range(12))


def test_bounds_are_below_the_distances_and_rule_out_nearly_all():
    rng = np.random.default_rng(1)
    table, point = clustered(rng, 4_000, 48), clustered(rng, 1, 48)[0]
    head = 24
    steps = np.abs(table[:, :head]).max(axis=0) / np.float32(32767)
    whole = np.round(table[:, :head] / steps).T.astype(np.int16)
    slack = 0.51 * np.linalg.norm(steps)
    rest, norms = np.linalg.norm(point[head:]), np.linalg.norm(table[:, head:], axis=1)
    bounds, best = np.empty(len(table), np.float32), np.empty(-(-len(table) // kernels.BLOCK), np.int64)
    kernels.bound_distances(
        whole, steps, norms.astype(np.float32), point[:head], np.float32(rest), bounds, best
    )
    rounded = (whole * steps[:, None]).T.astype(float)
    assert np.linalg.norm(rounded - table[:, :head], axis=1).max() <= slack
    expected = np.square(rounded - point[:head]).sum(axis=1) + (norms - rest) ** 2
    np.testing.assert_allclose(bounds, expected, rtol=1e-3)
    squares = np.square(table.astype(float) - point).sum(axis=1)
    assert (np.sqrt(bounds) <= np.sqrt(squares) * 1.0001 + slack).all()
    assert (bounds < np.sort(squares)[20]).mean() < 0.05
    blocks = [np.argmin(bounds[i : i + kernels.BLOCK]) + i for i in range(0, len(table), kernels.BLOCK)]
    np.testing.assert_array_equal(best, blocks)


def test_the_least_of_each_row_come_in_order_and_of_equal_ones_the_first() -> None:
    rng = np.random.default_rng(3)
    rows = rng.integers(0, 200, (3, 500)).astype(np.float32)
    least = kernels.least_of_rows(rows, 16)
    np.testing.assert_array_equal(least, np.argsort(rows, axis=1, kind="stable")[:, :16])
