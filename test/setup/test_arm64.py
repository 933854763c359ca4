"""tools/arm64/compare.py passes equal results of two computers and reports each kind of difference."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.skeleton import Source
from depth_pose.io.mcap_write import SkeletonWriter
from skeletons import make_skeleton

COMPARE = Path(__file__).parents[2] / "tools" / "arm64" / "compare.py"
FRAMES = 3


def write(path, *, frames=FRAMES, moved_m=0.0, **last):
    """Write a walk; in the last frame one joint is moved and the values of ``last`` are other ones."""
    with SkeletonWriter(path) as writer:
        for number in range(frames):
            positions = np.random.default_rng(number).normal(size=(19, 3))
            is_last = number == frames - 1
            positions[7, 2] += moved_m * is_last
            person = make_skeleton(positions, stamp_ns=1 + number, **(last if is_last else {}))
            writer.write_people([person], person.stamp_ns, "optical")
    return path


@pytest.mark.parametrize(
    ("code", "second", "line"),
    [
        (0, {}, "largest 0.0000 mm"),
        (0, {"moved_m": 0.0009}, "largest 0.9000 mm"),
        (1, {"moved_m": 0.0011}, "largest 1.1000 mm"),
        (1, {"body_id": "c"}, "frame 2: people or sources differ"),
        (1, {"source": Source.RECOVERED}, "frame 2: people or sources differ"),
        (1, {"joint_states": np.eye(19, dtype=np.uint8)[3]}, "joint states that differ: 1"),
        (1, {"frames": FRAMES - 1}, "the frames differ: 3 and 2"),
    ],
)
def test_compare(tmp_path, code, second, line):
    first, other = write(tmp_path / "a.mcap"), write(tmp_path / "b.mcap", **second)
    done = subprocess.run([sys.executable, COMPARE, first, other], capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    assert line in done.stdout
