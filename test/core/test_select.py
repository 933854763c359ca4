"""Selection by value against sorting."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core._select_kernels import kth_smallest


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("kinds", [2, 7, 10_000])
def test_every_rank_is_that_of_the_sorted_values(dtype, kinds):
    rng = np.random.default_rng(kinds)
    for size in (1, 2, 3, 50):
        values = rng.integers(0, kinds, size).astype(dtype)
        values[rng.random(size) < 0.1] = np.inf
        before = values.copy()
        assert [kth_smallest(values, k) for k in range(size)] == sorted(values)
        np.testing.assert_array_equal(values, before)
