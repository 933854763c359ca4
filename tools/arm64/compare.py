"""Compare the skeletons that two computers found in the same recording.

    python tools/arm64/compare.py FIRST.mcap SECOND.mcap [--within METRES]

FIRST and SECOND are outputs of ``depth-pose run``. Frames, ids, sources and joint states must be equal and
every joint position within the tolerance, 1 mm by default; the exit code is 1 otherwise.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import depth_pose

CLOSE_M = 1e-3
"""Largest distance between two positions of a joint, metres: below any sensor's resolution."""


def main() -> int:
    """Print what differs and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    parser.add_argument("--within", type=float, default=CLOSE_M, metavar="METRES")
    options = parser.parse_args()
    first, second = (list(depth_pose.read_skeletons(path)) for path in (options.first, options.second))
    if [m.stamp_ns for m in first] != [m.stamp_ns for m in second]:
        print(f"the frames differ: {len(first)} and {len(second)}")
        return 1
    pairs, differing = [], 0
    for number, (a, b) in enumerate(zip(first, second, strict=True)):
        if [(s.id, s.source) for s in a.skeletons] != [(s.id, s.source) for s in b.skeletons]:
            print(f"frame {number}: people or sources differ")
            differing += 1
            continue
        pairs += zip(a.skeletons, b.skeletons, strict=True)
    apart = np.array([np.linalg.norm(s.positions - t.positions, axis=1) for s, t in pairs])
    chance = [float(np.abs(s.joint_confidence - t.joint_confidence).max()) for s, t in pairs]
    states = sum(int((s.joint_states != t.joint_states).sum()) for s, t in pairs)
    print(f"frames {len(first)}, with other people or sources {differing}; skeletons {len(pairs)}")
    if not pairs:
        return 1
    print(
        f"joint positions apart: median {1e3 * np.median(apart):.4f} mm, largest {1e3 * apart.max():.4f} mm"
    )
    print(f"joint confidence apart: largest {max(chance):.2e}; joint states that differ: {states}")
    return int(differing > 0 or states > 0 or float(apart.max()) > options.within)


if __name__ == "__main__":
    sys.exit(main())
