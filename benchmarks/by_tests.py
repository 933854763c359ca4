"""Constants that no good recording brings out: each one halved and doubled, and which tests fail then.

    python benchmarks/by_tests.py rooms.clock rooms.clock_course --tests test/rooms/test_clock*.py
    python benchmarks/by_tests.py rooms.watch --only MOVED_M BACK_S --tests test/rooms/test_room_*.py

Whether a camera was moved, stopped, lags or has another clock, where limits lie, and how often something is
told are decided by constants that only tests reach. Where none fails, there is room on both sides, or no test
reaches the constant. A module is changed as it is imported, in all processes that a test starts, before
anything is derived from the constant. Kernels that are compiled with it need a cache of their own
(``NUMBA_CACHE_DIR``).
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

from command_line import make_parser
from parts.changed_constant.factors import FACTORS, environment
from parts.constants import defined, is_number, shown


def failures(constant: str, factor: float, tests: list[Path], seconds: float) -> str:
    """Tell which tests fail with a constant, as ``rooms.watch:MOVED_M``, times a factor."""
    command = [sys.executable, "-m", "pytest", "-q", "-rfE", "--tb=no", "-p", "no:cacheprovider"]
    try:
        ended = subprocess.run(
            [*command, *map(str, tests)],
            env=os.environ | environment(constant, factor),
            timeout=seconds,
            capture_output=True,
            text=True,
        )
    except subprocess.TimeoutExpired:
        return f"not done after {seconds:g} s"
    names = re.findall(r"^(?:FAILED|ERROR) [^:]+::(.+?)(?: - .*)?$", ended.stdout, re.MULTILINE)
    if names or ended.returncode == 0:
        return f"{len(names)}: {', '.join(names)}" if names else "none"
    return f"pytest ended with {ended.returncode}: {ended.stderr.strip().rpartition(chr(10))[2]}"


def main() -> None:
    """Run and report."""
    parser = make_parser(__doc__)
    parser.add_argument("modules", nargs="+", help="below depth_pose, as rooms.watch")
    parser.add_argument("--tests", type=Path, nargs="+", required=True, help="files of tests")
    parser.add_argument("--only", nargs="+", help="names of constants; all of the modules' if none is given")
    parser.add_argument("--seconds", type=float, default=600, help="most time for the tests of one value")
    given = parser.parse_args()
    print("| | value | tests that fail with half | with double |\n|---|---|---|---|")
    for module in given.modules:
        place = import_module(f"depth_pose.{module}")
        for name in defined(place):
            value = getattr(place, name)
            if name.isupper() and is_number(value) and (given.only is None or name in given.only):
                told = [failures(f"{module}:{name}", f, given.tests, given.seconds) for f in FACTORS]
                print(f"| {module}.{name} | {shown(value)} | {' | '.join(told)} |", flush=True)


if __name__ == "__main__":
    main()
