"""How well the procedural poses cover recorded motion, and pictures of both.

    python benchmarks/banks.py coverage FOLDER_OF_BVH docs/images

Prints the table of docs/method.md and writes its pictures.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
from command_line import make_parser
from matplotlib import pyplot as plt
from numpy.typing import NDArray

from depth_pose.core.skeleton import BONES, JOINTS
from depth_pose.motion.clip import PoseSet, joint_positions
from depth_pose.motion.motion_files import load_motion_dir
from depth_pose.motion.procedural.generator import make_poses

Array = NDArray[np.float64]


def measure(poses: PoseSet, wanted: PoseSet) -> Array:
    """Mean joint distance of each pose to the nearest of a set, metres (N,).

    The pelvis is at the origin, the heading removed, the body 1.75 m tall.
    """
    rows, queries = (joint_positions(s.rotations).astype(np.float32) for s in (poses, wanted))
    return np.array([np.linalg.norm(rows - query, axis=-1).mean(axis=-1).min() for query in queries])


def table(distance_m: Array, families: Sequence[str]) -> str:
    """Median, 90th percentile and largest distance in mm, over all and per family, as text."""
    names = np.array(families)
    lines = [f"{'family':24s} {'poses':>7s} {'median':>7s} {'p90':>7s} {'max':>7s}   (mm)"]
    for name in ("", *sorted(set(families))):
        rows = distance_m[names == name] if name else distance_m
        figures = (np.median(rows), np.percentile(rows, 90), rows.max())
        lines.append(
            f"{name or 'all':24s} {len(rows):7d} " + " ".join(f"{1000 * figure:7.0f}" for figure in figures)
        )
    return "\n".join(lines)


def plot_coverage(sets: Sequence[tuple[str, PoseSet]], path: str | Path, limit: int = 4000) -> None:
    """Draw sets of poses in the plane of their two largest principal components, to an image file.

    Parameters
    ----------
    sets : sequence of (label, PoseSet)
        Drawn in this order; the components are those of all together.
    path : path
        Written as matplotlib understands its extension.
    limit : int
        Poses drawn of each set, evenly spaced.
    """
    thinned = [poses.take(np.unique(np.linspace(0, len(poses) - 1, limit).astype(int))) for _, poses in sets]
    joints = [
        joint_positions(poses.rotations).reshape(len(poses), -1) / np.sqrt(len(JOINTS)) for poses in thinned
    ]
    everything = np.concatenate(joints)
    mean = everything.mean(axis=0)
    values, axes = np.linalg.eigh(np.cov((everything - mean).T))
    share = values[::-1] / values.sum()
    figure, panels = plt.subplots(1, 2, figsize=(12, 5.6), constrained_layout=True)
    for panel, (a, b) in zip(panels, ((0, 1), (2, 3)), strict=True):
        for (label, _), rows in zip(sets, joints, strict=True):
            flat = (rows - mean) @ axes[:, ::-1]
            panel.scatter(
                flat[:, a], flat[:, b], s=3, alpha=0.45, label=f"{label} ({len(rows)})", linewidths=0
            )
        panel.set_xlabel(f"component {a + 1} (m RMS), {100 * share[a]:.0f} % of the variance")
        panel.set_ylabel(f"component {b + 1} (m RMS), {100 * share[b]:.0f} %")
        panel.set_aspect("equal")
    panels[0].legend(markerscale=4)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_sticks(panel: Any, joints: Array, offset: float = 0.0, azimuth_deg: float = 25.0) -> None:
    """Draw one (19, 3) pose into a matplotlib panel, seen from in front and a little aside.

    The person's left limbs are blue, the right ones red, the trunk black.
    """
    turn = np.radians(azimuth_deg)
    # Seen from in front: the person's left (+x) is to the right of the picture.
    across = joints[:, 0] * np.cos(turn) + joints[:, 2] * np.sin(turn) + offset
    up = joints[:, 1]
    for a, b in BONES:
        name = JOINTS[b]
        colour = "tab:blue" if name.startswith("left") else "tab:red" if name.startswith("right") else "k"
        panel.plot(across[[a, b]], up[[a, b]], color=colour, linewidth=1.6, solid_capstyle="round")
    panel.plot(across[4], up[4] + 0.09, "ko", markersize=5, fillstyle="none")


def plot_families(poses: PoseSet, path: str | Path, columns: int = 12, seed: int = 0) -> None:
    """Draw some poses of every family as stick figures, one family a row, to an image file."""
    names = sorted(set(poses.families))
    rng = np.random.default_rng(seed)
    figure, panels = plt.subplots(
        len(names), 1, figsize=(1.25 * columns, 1.75 * len(names)), squeeze=False, constrained_layout=True
    )
    families = np.array(poses.families)
    for panel, name in zip(panels[:, 0], names, strict=True):
        rows = np.flatnonzero(families == name)
        rows = np.sort(rng.choice(rows, min(columns, len(rows)), replace=False))
        for k, joints in enumerate(joint_positions(poses.rotations[rows])):
            draw_sticks(panel, joints, offset=1.35 * k, azimuth_deg=(0, 40, -40, 80)[k % 4])
        panel.set_title(name, fontsize=12, loc="left", pad=1)
        panel.set_aspect("equal")
        panel.set_xlim(-0.9, 1.35 * columns - 0.4)
        panel.set_ylim(-1.05, 1.15)
        panel.axis("off")
    figure.savefig(path, dpi=55)
    plt.close(figure)


def main() -> None:
    """Measure and draw."""
    parser = make_parser(__doc__)
    parser.add_argument("motion", type=Path, help="folder of recorded motion (BVH, ASF/AMC)")
    parser.add_argument("pictures", type=Path, help="folder for the pictures")
    parser.add_argument("--counts", type=int, nargs="+", default=[500, 2000, 8000])
    arguments = parser.parse_args()
    recorded = load_motion_dir(arguments.motion).poses(mirrored=False)
    for count in arguments.counts:
        start = time.process_time()
        poses = make_poses(count)
        print(f"\n{count} procedural poses, made in {time.process_time() - start:.1f} s of one core")
        print(table(measure(poses, recorded), recorded.families))
    draw(poses, recorded, arguments.pictures)


def draw(poses: PoseSet, recorded: PoseSet, folder: Path) -> None:
    """Write the pictures of docs/method.md."""
    folder.mkdir(parents=True, exist_ok=True)
    plot_coverage([("procedural", poses), ("recorded", recorded)], folder / "motion_coverage.png")
    names = sorted(set(poses.families))
    half = (len(names) + 1) // 2
    for i, part in enumerate((names[:half], names[half:]), start=1):
        rows = np.flatnonzero(np.isin(np.array(poses.families), part))
        plot_families(poses.take(rows), folder / f"motion_families_{i}.png", columns=10)
