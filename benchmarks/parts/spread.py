"""Compare the published covariances and velocities of joints with their errors.

    python benchmarks/accuracy.py spread                          # simulated people, as for ``confidence``
    python benchmarks/accuracy.py spread --check DATA [DATA ...]

Printed are the shares of errors within one and two standard deviations, across the ray (each of two
directions) and along it (of normal errors: .683 and .954), and the errors of the velocities against the
difference quotient of the true joints, from the fourth frame of a person on. DATA are folders of recordings
with truth files beside them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JointState
from depth_pose.evaluate.truth import load_known_people
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline
from parts.confidence import simulated

_SETTLED = 4
"""Frames after which a person's velocities are judged."""

_NOBODY_M = 0.4
"""Skeletons farther than this from every person are left out, metres."""


def measure(pipeline: PosePipeline, path: Path) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield for each skeleton: errors and deviations in the ray's axes, states, and errors of velocities."""
    truth = load_known_people(path.with_suffix(".npz"))
    seconds = truth.stamps_ns * 1e-9
    true_velocity = np.gradient(truth.joints, seconds, axis=0)
    frames: dict[str, int] = {}
    pipeline.reset()
    for frame in DepthReader(path):
        at = int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))
        for skeleton in pipeline.process_frame(frame).skeletons:
            apart = np.linalg.norm(skeleton.positions - truth.joints[at], axis=2).mean(axis=1)
            if not np.nanmin(apart, initial=np.inf) < _NOBODY_M:
                continue
            person = int(np.nanargmin(apart))
            frames[skeleton.body_id] = frames.get(skeleton.body_id, 0) + 1
            error, deviation = in_ray_axes(skeleton, truth.joints[at, person])
            motion = np.full((19, 2, 3), np.nan)
            if frames[skeleton.body_id] >= _SETTLED and len(skeleton.velocities):
                motion[:, 0], motion[:, 1] = skeleton.velocities, true_velocity[at, person]
            yield error, deviation, skeleton.joint_states, motion


def in_ray_axes(skeleton: Skeleton, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and standard deviations (19, 3) in two directions across the ray and along it, metres."""
    along = skeleton.positions / np.linalg.norm(skeleton.positions, axis=1, keepdims=True)
    side = np.cross([0.0, 1.0, 0.0], along)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    axes = np.stack([side, np.cross(along, side), along], axis=1)
    error = np.einsum("jab,jb->ja", axes, skeleton.positions - known)
    variance = np.einsum("jab,jbc,jac->ja", axes, skeleton.covariances, axes)
    return error, np.sqrt(variance)


def report(label: str, rows: Iterable[tuple[np.ndarray, ...]]) -> None:
    """Print the shares within one and two deviations, and the errors of the velocities."""
    error, deviation, states, motion = (np.array(column) for column in zip(*rows, strict=True))
    print(f"{label}: {len(error)} skeletons")
    ratio = np.abs(error) / deviation
    for name, chosen in (("all", states >= 0), ("seen", states == JointState.SEEN),
                         ("hidden or outside", states != JointState.SEEN)):  # fmt: skip
        if not chosen.any():
            continue
        across, ahead = ratio[chosen][:, :2], ratio[chosen][:, 2]
        side_mm, depth_mm = 1e3 * np.median(deviation[chosen][:, [0, 2]], axis=0)
        print(
            f"    {name:18s} across .683: {np.nanmean(across < 1):.3f}, .954: {np.nanmean(across < 2):.3f}; "
            f"along {np.nanmean(ahead < 1):.3f}, {np.nanmean(ahead < 2):.3f}; median deviation "
            f"{side_mm:.0f} and {depth_mm:.0f} mm"
        )
    off = np.linalg.norm(motion[:, :, 0] - motion[:, :, 1], axis=2)
    speed = np.linalg.norm(motion[:, :, 1], axis=2)
    for name, low, high in (
        ("below .2 m/s", 0.0, 0.2),
        (".2 to 1 m/s", 0.2, 1.0),
        ("above 1 m/s", 1.0, 99.0),
    ):
        chosen = (speed >= low) & (speed < high)
        if chosen.any():
            print(f"    velocities of joints {name:13s} median error {np.median(off[chosen]):.2f} m/s")


def main() -> None:
    """Run over recordings or simulated people, and report."""
    parser = make_parser(__doc__)
    parser.add_argument("--clips", type=int, default=12, help="number of simulated clips")
    parser.add_argument(
        "--check", type=Path, nargs="+", default=[], help="folders of recordings with truth files"
    )
    arguments = parser.parse_args()
    pipeline = PosePipeline(Bank.load(default_bank_path()))
    pipeline.warm_up()
    for folder in arguments.check:
        paths = [p for p in sorted(folder.glob("*.mcap")) if p.with_suffix(".npz").exists()]
        report(folder.name, [row for path in paths for row in measure(pipeline, path)])
    if not arguments.check:
        with tempfile.TemporaryDirectory() as made:
            clips = simulated(Path(made), arguments.clips, [])
            report("simulated", [row for path in clips for row in measure(pipeline, path)])
