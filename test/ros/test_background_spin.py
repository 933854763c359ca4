"""Programs that spin a node in a thread end without an abort of the process."""

import os
import subprocess
import sys
from pathlib import Path

from peer import LIMIT_S

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"

PROGRAM = """
import time
import rclpy
from parts.background_spin import spin_in_background

rclpy.init(args=[])
node = rclpy.create_node("busy")
node.create_timer(0.001, lambda: None)
spin_in_background(node)
time.sleep(0.3)
"""


def test_a_benchmark_that_spins_in_the_background_ends_cleanly():
    """Without the shutdown at exit it ends with 134 (SIGABRT)."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=os.environ | {"PYTHONPATH": str(BENCHMARKS)},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )
    assert done.returncode == 0, done.stderr
