"""Error and flips of the best match alone, single frames, and what the score says about them.

    python benchmarks/bank_match.py DATA embedded=a.npz recorded=b.npz --pictures docs/images

DATA holds recordings NAME.mcap with truth files NAME.npz. Each frame is matched by itself, with
the size that the matcher found over the first frames. Prints the tables of docs/bank.md: the best
of the shortlist by rendered depth, the nearest in the subspace (the paper's match), and the
reliability of the score.
"""

from __future__ import annotations

import argparse
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
from bank_common import (
    Recording,
    find_scale,
    is_flipped,
    joints_of,
    load_recording,
    mean_error,
    recordings,
)

from depth_pose.bank import Bank
from depth_pose.config import MatchConfig
from depth_pose.steps.match import Matcher

_RIGHT_M = 0.1
"""A match whose joints are off by less than this on average counts as right."""


def measure(bank: Bank, recorded: list[Recording], shortlist: int) -> dict[str, np.ndarray]:
    """Error (m), flip, score, best error of those kept (m), time (ms) and recording of every frame."""
    rows = []
    for number, recording in enumerate(recorded):
        scale = find_scale(bank, recording.clouds)
        matcher = Matcher(bank, MatchConfig(scale=scale, shortlist=shortlist))
        for cloud, known in zip(recording.clouds, recording.joints, strict=True):
            start = time.thread_time()
            match = matcher.match(cloud)
            taken = time.thread_time() - start
            if not match.candidates:
                continue
            found = [joints_of(bank, match, k) for k in range(len(match.candidates))]
            errors = [mean_error(f, known) for f in found]
            score = match.candidates[0].score
            rows.append(
                (errors[0], is_flipped(found[0], known), score, min(errors), 1e3 * taken, number, scale)
            )
    names = ("error", "flip", "score", "best", "ms", "recording", "scale")
    return dict(zip(names, np.array(rows, float).T, strict=True))


def report(label: str, found: dict[str, np.ndarray], recorded: list[Recording]) -> None:
    """Print a bank's row, and below it each recording's error."""
    e, right = found["error"], found["error"] < _RIGHT_M
    print(
        f"{label:28s} {1e3 * e.mean():6.0f} {1e3 * np.median(e):6.0f} {100 * found['flip'].mean():6.1f} "
        f"{100 * right.mean():6.0f} {1e3 * found['best'].mean():6.0f} {np.median(found['ms']):6.1f}"
    )
    parts = []
    for number, recording in enumerate(recorded):
        mine = found["recording"] == number
        if mine.any():
            parts.append(f"{recording.name} {1e3 * e[mine].mean():.0f} (scale {found['scale'][mine][0]:.2f})")
    print("    " + ", ".join(parts), flush=True)


def reliability(found: dict[str, np.ndarray]) -> None:
    """Print how often matches of a score are right."""
    edges = np.concatenate([[0.0], np.arange(0.3, 0.75, 0.05), [1.0]])
    print(f"{'score':>12s} {'frames':>7s} {'right %':>8s} {'flips %':>8s} {'error mm':>9s} {'fitted %':>9s}")
    chance = fit_chance(found["score"], found["error"] < _RIGHT_M)
    for low, high in pairwise(edges):
        mine = (found["score"] >= low) & (found["score"] < high)
        if mine.sum() < 5:
            continue
        error, flips = found["error"][mine], found["flip"][mine]
        fitted = chance(found["score"][mine]).mean()
        print(
            f"{low:5.2f} - {high:4.2f} {mine.sum():7d} {100 * (error < _RIGHT_M).mean():8.0f} "
            f"{100 * flips.mean():8.1f} {1e3 * error.mean():9.0f} {100 * fitted:9.0f}"
        )
    order = np.argsort(found["score"])
    wrong = found["error"][order] >= _RIGHT_M
    ranks = np.flatnonzero(wrong).sum() - wrong.sum() * (wrong.sum() - 1) / 2
    area = ranks / max(wrong.sum() * (~wrong).sum(), 1)
    print(f"area under the curve of the score for a wrong match: {area:.2f}")


def fit_chance(score: np.ndarray, right: np.ndarray):
    """Logistic curve of the chance that a match is right, by Newton's method; prints its two figures."""
    design = np.stack([np.ones_like(score), score], axis=1)
    weights = np.zeros(2)
    for _ in range(30):
        p = 1 / (1 + np.exp(-design @ weights))
        hessian = design.T @ (design * (p * (1 - p))[:, None]) + 1e-3 * np.eye(2)
        weights += np.linalg.solve(hessian, design.T @ (right - p) - 1e-3 * weights)
    print(f"even chance at score {-weights[0] / weights[1]:.3f}, spread {-1 / weights[1]:.3f}")
    return lambda s: 1 / (1 + np.exp(-(weights[0] + weights[1] * s)))


def draw_reliability(found: dict[str, dict[str, np.ndarray]], path: Path) -> None:
    """Draw the share of right matches against the score."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4), layout="constrained")
    axes = figure.add_subplot()
    edges = np.arange(0.25, 0.85, 0.05)
    for label, rows in found.items():
        x, y = [], []
        for low in edges:
            mine = (rows["score"] >= low) & (rows["score"] < low + 0.05)
            if mine.sum() >= 8:
                x.append(rows["score"][mine].mean())
                y.append((rows["error"][mine] < _RIGHT_M).mean())
        axes.plot(x, y, "o-", label=label)
    axes.set(xlabel="score of the best match", ylabel="share within 100 mm", ylim=(-0.03, 1.03))
    axes.grid(alpha=0.3)
    axes.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure every bank on every recording."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("banks", nargs="+", metavar="LABEL=FILE")
    parser.add_argument("--step", type=int, default=3, help="use every so many frames")
    parser.add_argument("--shortlist", type=int, nargs="+", default=[1, 10, MatchConfig().shortlist])
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    recorded = [load_recording(path, arguments.step) for path in recordings(arguments.data)]
    print(f"{sum(len(r.clouds) for r in recorded)} frames of {len(recorded)} recordings")
    print(
        f"{'bank, compared':28s} {'mean':>6s} {'median':>6s} {'flip %':>6s} {'right%':>6s} best-of-kept  ms"
    )
    drawn = {}
    for text in arguments.banks:
        label, _, file = text.partition("=")
        bank = Bank.load(file)
        for shortlist in arguments.shortlist:
            found = measure(bank, recorded, shortlist)
            report(f"{label}, {shortlist}", found, recorded)
        reliability(found)
        drawn[label] = found
    if arguments.pictures:
        draw_reliability(drawn, arguments.pictures / "bank_reliability.png")


if __name__ == "__main__":
    main()
