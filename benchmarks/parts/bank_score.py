"""Calibrate the matcher's score to a confidence, on simulated people, and check it on recordings.

    python benchmarks/banks.py score embedded=a.npz recorded=b.npz --mocap captures --check DATA

Fifty clips of people of other builds than the bank's, at other distances, from all around and from
-10 to 45 degrees of elevation, with the noise of a time-of-flight sensor, move as the embedded
source does and, with ``--mocap``, as BVH files do. A match counts as right if its joints are
within 100 mm on average and left and right are not swapped. Prints the two figures of
`depth_pose.match.match.match_confidence`, and how often matches of a confidence are right: on the
simulated clips and, with ``--check``, on recordings with known joints, which are not used in the fit.
"""

from __future__ import annotations

import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank
from depth_pose.core.odds import logistic
from depth_pose.match.match import match_confidence
from depth_pose.match.tuning import MatchTuning
from depth_pose.motion.procedural.generator import CLIPS
from depth_pose.sim.config import Room
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import Stage, simulate
from parts.known_people import (
    RIGHT_M,
    Recording,
    is_flipped,
    joints_of,
    load_recording,
    make_matcher,
    mean_error,
    recordings,
)
from parts.random_people import aimed, person_of

_CLIPS, _FRAMES, _FPS = 50, 14, 5.0
"""Simulated clips, their frames, and frames a second. Set by hand."""


def simulated(folder: Path, captures: list[Path]) -> list[Recording]:
    """Simulate people, views and motions drawn at random."""
    rng = np.random.default_rng(7)
    names, found = sorted(CLIPS), []
    for k in range(_CLIPS):
        build = rng.uniform(-1.0, 1.0, 6)
        body = person_of(1.7 + 0.2 * build[0], build[1:]).body()
        motion = str(captures[rng.integers(len(captures))]) if captures and k % 2 else names[k % len(names)]
        elevation, distance = rng.uniform(-10, 45), rng.uniform(2.8, 4.2)
        place = aimed(distance, elevation, rng.uniform(-180, 180))
        clip = load_motion(motion, _FPS, _FRAMES / _FPS, seed=1000 + k)
        path = folder / f"{k}.mcap"
        simulate(path, body, clip, Stage(placement=place, room=Room(floor=False, wall=0.0)), seed=k)
        found.append(load_recording(path))
        print(f"simulated {k + 1} of {_CLIPS}", end="\r", flush=True)
    print()
    return found


def measure(bank: Bank, recorded: list[Recording]) -> np.ndarray:
    """Score and correctness of the best match of every frame."""
    rows = []
    for recording in recorded:
        matcher = make_matcher(bank, MatchTuning(search_every=1))
        for people, known in zip(recording.people, recording.joints, strict=True):
            for match in matcher.match(people):
                found = joints_of(bank, match)
                right = mean_error(found, known) < RIGHT_M and not is_flipped(found, known)
                rows.append((match.candidates[0].score, right))
    return np.array(rows, float)


def fit(rows: np.ndarray) -> tuple[float, float]:
    """Fit a logistic curve to the right matches by Newton's method: score at one half, and spread."""
    score, right = rows.T
    design = np.stack([np.ones_like(score), score], axis=1)
    weights = np.zeros(2)
    for _ in range(30):
        p = logistic(design @ weights)
        hessian = design.T @ (design * (p * (1 - p))[:, None]) + 1e-3 * np.eye(2)
        weights += np.linalg.solve(hessian, design.T @ (right - p) - 1e-3 * weights)
    return float(-weights[0] / weights[1]), float(-1 / weights[1])


def report(label: str, rows: np.ndarray) -> np.ndarray:
    """Print the share of right matches against the confidence; return the bins for drawing."""
    score, right = rows.T
    confidence = np.array([match_confidence(s) for s in score])
    order = np.argsort(score)
    wrong = right[order] == 0
    ranks = np.flatnonzero(wrong).sum() - wrong.sum() * (wrong.sum() - 1) / 2
    area = ranks / max(wrong.sum() * (~wrong).sum(), 1)
    bins, off = [], 0.0
    print(f"{label}: {len(rows)} frames, {100 * right.mean():.0f} % right, area under the curve {area:.2f}")
    for low, high in pairwise(np.linspace(0, 1, 6)):
        mine = (confidence >= low) & (confidence < high + (high == 1))
        if mine.any():
            bins.append((confidence[mine].mean(), right[mine].mean(), mine.sum()))
            off += mine.mean() * abs(bins[-1][0] - bins[-1][1])
            print(
                f"    confidence {low:.1f} to {high:.1f}: {mine.sum():4d} frames, "
                f"{100 * bins[-1][1]:3.0f} % right"
            )
    print(f"    expected calibration error {off:.3f}", flush=True)
    return np.array(bins)


def draw(bins: dict[str, np.ndarray], path: Path) -> None:
    """Draw the share of right matches against their mean confidence; areas are numbers of frames."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2, 5), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.7", zorder=0)
    for label, table in bins.items():
        (line,) = axes.plot(table[:, 0], table[:, 1], label=label)
        axes.scatter(table[:, 0], table[:, 1], s=3 + 0.6 * table[:, 2], color=line.get_color())
    axes.set(xlabel="confidence of the best match", ylabel="share that is right (within 100 mm, not flipped)")
    axes.set(xlim=(0, 1), ylim=(-0.03, 1.03), aspect="equal")
    axes.grid(alpha=0.3)
    axes.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Simulate, match, fit and report."""
    parser = make_parser(__doc__)
    parser.add_argument("banks", nargs="+", metavar="LABEL=FILE")
    parser.add_argument("--mocap", type=Path, help="BVH files; every second clip moves as one of them")
    parser.add_argument("--check", type=Path, help="recordings with truth files")
    parser.add_argument("--step", type=int, default=2, help="use every n-th frame of the recordings")
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    captures = sorted(arguments.mocap.glob("*.bvh")) if arguments.mocap else []
    banks = {label: Bank.load(file) for label, _, file in (b.partition("=") for b in arguments.banks)}
    with tempfile.TemporaryDirectory() as folder:
        people = simulated(Path(folder), captures)
    matched = {f"{label}, simulated": measure(bank, people) for label, bank in banks.items()}
    middle, spread = fit(np.concatenate(list(matched.values())))
    print(f"fitted to the simulated clips: even chance at score {middle:.3f}, spread {spread:.4f}")
    if arguments.check:
        known = [load_recording(path, arguments.step) for path in recordings(arguments.check)]
        matched |= {f"{label}, recordings": measure(bank, known) for label, bank in banks.items()}
    bins = {label: report(label, rows) for label, rows in matched.items()}
    if arguments.pictures:
        draw(bins, arguments.pictures / "bank_reliability.png")
