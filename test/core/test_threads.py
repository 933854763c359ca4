"""Threads for the people of a frame, and linear algebra in one thread meanwhile."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from depth_pose.core.errors import ConfigError
from depth_pose.core.threads import Threads, check_threads, one_thread_each


@pytest.mark.parametrize("count", [1, 2])
def test_values_come_in_the_order_of_the_arguments(count: int) -> None:
    assert Threads(count).map(lambda n: n * n, range(6)) == [0, 1, 4, 9, 16, 25]
    with pytest.raises(ZeroDivisionError):
        Threads(count).map(lambda n: 1 // n, [2, 1, 0, 3])


def test_two_run_at_the_same_time() -> None:
    both = threading.Barrier(2, timeout=20.0)
    assert sorted(Threads(2).map(lambda _: both.wait(), range(2))) == [0, 1]


@pytest.mark.parametrize("count", [0, 3, -1, True, "2"])
def test_other_numbers_are_refused(count: object) -> None:
    with pytest.raises(ConfigError, match="threads is"):
        check_threads(count)  # type: ignore[arg-type]


def test_linear_algebra_is_in_one_thread_until_the_last_has_left() -> None:
    np.linalg.solve(np.eye(2), np.ones(2))

    def counts() -> list[int]:
        return [library["num_threads"] for library in threadpool_info()]

    before = counts()
    with one_thread_each:
        with one_thread_each:
            assert set(counts()) == {1}
        assert set(counts()) == {1}
    assert counts() == before
