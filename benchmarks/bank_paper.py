"""The paper's match as printed, with mirror images, and restricted to rotations (Sec. 5).

    python benchmarks/bank_paper.py DATA BANK

The poses of BANK are rendered in the four frames of the paper. Each frame's cloud is put into its
own principal axes and takes the nearest depth map of the subspace (eq. 6), and nothing else: no
comparison of rendered depth. A mirrored frame shows its body mirrored where it is placed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from bank_common import Recording, find_scale, is_flipped, load_recording, mean_error, recordings
from command_line import make_parser

from depth_pose.bank import Bank
from depth_pose.bank.build import learn_subspace, project
from depth_pose.bank.canonical import describe
from depth_pose.bank.views import AXES, PoseViews, render_views
from depth_pose.core.skeleton import JOINT_NODES


def measure(
    bank: Bank, poses: np.ndarray, views: PoseViews, used: int, recorded: list[Recording]
) -> np.ndarray:
    """Error (m) and flip of every frame, with the first ``used`` frames of each pose."""
    descriptors = np.ascontiguousarray(views.descriptors[:, :used])
    subspace = learn_subspace(descriptors.reshape(-1, descriptors.shape[-1]), 48)
    entries = project(descriptors, subspace).reshape(-1, 48)
    rows = []
    for recording in recorded:
        scale = find_scale(bank, recording.people)
        for people, known in zip(recording.people, recording.joints, strict=True):
            if not people.persons:
                continue
            points = people.persons[0].points
            (axes,) = AXES["paper"](points)
            gamma = subspace.components @ (describe(points, axes, scale) - subspace.mean)
            pose, frame = divmod(int(np.argmin(np.square(entries - gamma).sum(axis=1))), used)
            joints = bank.body.pose(bank.rotations(poses[pose]), np.zeros(3)).nodes[JOINT_NODES]
            canonical = (joints - views.origins[pose, frame]) @ views.rotations[pose, frame].T
            found = scale * canonical @ axes.rotation + axes.origin
            rows.append((mean_error(found, known), is_flipped(found, known)))
    return np.array(rows, float)


def main() -> None:
    """Render, match, and print both variants."""
    parser = make_parser(__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("bank", type=Path)
    parser.add_argument("--step", type=int, default=6, help="use every so many frames")
    arguments = parser.parse_args()
    bank = Bank.load(arguments.bank)
    recorded = [load_recording(path, arguments.step) for path in recordings(arguments.data)]
    poses = np.arange(bank.poses)
    rotations = np.stack([bank.rotations(k) for k in poses])
    views = render_views(bank.body, rotations, 0, "paper-mirrored")
    for name, used in (("as printed, 4 frames", 4), ("rotations only, 2 frames", 2)):
        error, flips = measure(bank, poses, views, used, recorded).T
        print(
            f"{name:26s} mean {1e3 * error.mean():.0f} mm, median {1e3 * np.median(error):.0f} mm, "
            f"flips {100 * flips.mean():.1f} %, {len(error)} frames"
        )


if __name__ == "__main__":
    main()
