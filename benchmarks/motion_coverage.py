"""How well the procedural poses cover recorded motion, and pictures of both.

    python benchmarks/motion_coverage.py FOLDER_OF_BVH docs/images

Prints the table of docs/motion.md and writes its pictures.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from depth_pose.motion.clip import PoseSet
from depth_pose.motion.coverage import measure_coverage, plot_coverage, plot_families
from depth_pose.motion.motion_files import load_motion_dir
from depth_pose.motion.procedural.generator import make_poses


def main() -> None:
    """Measure and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("motion", type=Path, help="folder of recorded motion (BVH, ASF/AMC)")
    parser.add_argument("pictures", type=Path, help="folder for the pictures")
    parser.add_argument("--counts", type=int, nargs="+", default=[500, 2000, 8000])
    arguments = parser.parse_args()
    recorded = load_motion_dir(arguments.motion).poses(mirrored=False)
    for count in arguments.counts:
        start = time.process_time()
        poses = make_poses(count)
        print(f"\n{count} procedural poses, made in {time.process_time() - start:.1f} s of one core")
        print(measure_coverage(poses, recorded).table())
    draw(poses, recorded, arguments.pictures)


def draw(poses: PoseSet, recorded: PoseSet, folder: Path) -> None:
    """Write the pictures of docs/motion.md."""
    folder.mkdir(parents=True, exist_ok=True)
    plot_coverage([("procedural", poses), ("recorded", recorded)], folder / "motion_coverage.png")
    names = sorted(set(poses.families))
    half = (len(names) + 1) // 2
    for i, part in enumerate((names[:half], names[half:]), start=1):
        rows = np.flatnonzero(np.isin(np.array(poses.families), part))
        plot_families(poses.take(rows), folder / f"motion_families_{i}.png", columns=10)


if __name__ == "__main__":
    main()
