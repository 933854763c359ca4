"""Constants that only faults bring out: each one halved and doubled, and which tests fail then.

    python benchmarks/by_tests.py rooms.clock rooms.clock_course --tests test/rooms/test_clock*.py
    python benchmarks/by_tests.py rooms.watch --tests test/rooms/test_room_*.py

Whether a camera was moved, stopped, lags or has another clock is decided by constants that no good recording
reaches; tests simulate such rooms. Where none fails, both values decide as the present one. Each run is
another process, since modules copy each other's values.
"""

from __future__ import annotations

import contextlib
import io
import multiprocessing
from importlib import import_module
from pathlib import Path

import pytest
from command_line import make_parser
from parts.constants import FACTORS, defined, is_number, shown, times


class Failed:
    """Collects the tests that fail."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a failed test."""
        if report.failed:
            self.names.append(report.nodeid.rpartition("::")[2])


def failures(module: str, name: str, factor: float, tests: list[Path]) -> list[str]:
    """Return the tests that fail with a constant times a factor."""
    place = import_module(f"depth_pose.{module}")
    setattr(place, name, times(getattr(place, name), factor))
    failed = Failed()
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main(["-q", "-p", "no:cacheprovider", *map(str, tests)], [failed])
    return failed.names


def main() -> None:
    """Run and report."""
    parser = make_parser(__doc__)
    parser.add_argument("modules", nargs="+", help="below depth_pose, as rooms.watch")
    parser.add_argument("--tests", type=Path, nargs="+", required=True, help="files of tests")
    arguments = parser.parse_args()
    print("| | value | tests that fail with half | with double |\n|---|---|---|---|")
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        for module in arguments.modules:
            place = import_module(f"depth_pose.{module}")
            for name in defined(place):
                value = getattr(place, name)
                if name.isupper() and is_number(value):
                    asked = [(module, name, factor, arguments.tests) for factor in FACTORS]
                    found = pool.starmap(failures, asked, chunksize=1)
                    told = [f"{len(names)}: {', '.join(names)}" if names else "none" for names in found]
                    print(f"| {module}.{name} | {shown(value)} | {' | '.join(told)} |", flush=True)


if __name__ == "__main__":
    main()
