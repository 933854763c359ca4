"""Measure how long skeletons are missing after each fault of docs/faults.md.

    python benchmarks/faults.py --times 3
    python benchmarks/faults.py --times 10 --only killed

Each row is a test of ``test/ros/test_faults.py``, which does it to real nodes over real DDS; told are
the median and the worst of the times until skeletons came again, and the median of the frames lost.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
"""The repository."""


def run_tests(notes: Path, only: str) -> None:
    """Run the tests once; each writes a line."""
    choice = ["-k", only] if only else []
    environment = os.environ | {"DEPTH_POSE_FAULTS": str(notes)}
    command = [sys.executable, "-m", "pytest", "-q", "test/ros/test_faults.py", *choice]
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    last = result.stdout.strip().splitlines()[-1]
    print(f"{last}; load average {os.getloadavg()[0]:.1f}", flush=True)
    if result.returncode:
        print(result.stdout)


def as_table(lines: list[str]) -> str:
    """Give the rows of all runs, one for each fault."""
    rows: dict[str, list[list[str]]] = defaultdict(list)
    for line in lines:
        fault, *rest = line.split("\t")
        rows[fault].append(rest)
    out = ["| fault | what is seen | skeletons again after: median, worst | frames lost | runs |"]
    out.append("|---|---|---|---|---|")
    for fault, found in rows.items():
        again = [float(r[1]) for r in found if r[1] != "None"]
        lost = [float(r[2]) for r in found if r[2] != "None"]
        times = f"{statistics.median(again):.1f} s, {max(again):.1f} s" if again else ""
        frames = f"{statistics.median(lost):.0f}" if lost else ""
        out.append(f"| {fault} | {found[-1][0]} | {times} | {frames} | {len(found)} |")
    return "\n".join(out)


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--times", type=int, default=1, help="runs of all tests")
    parser.add_argument("--only", default="", help="an expression of pytest's -k")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        notes = Path(folder) / "notes.tsv"
        for _ in range(arguments.times):
            run_tests(notes, arguments.only)
        print("\n" + as_table(notes.read_text().splitlines() if notes.is_file() else []))


if __name__ == "__main__":
    main()
