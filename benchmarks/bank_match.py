"""Error and flips of the best match alone, single frames.

    python benchmarks/bank_match.py DATA embedded=a.npz recorded=b.npz

DATA holds recordings NAME.mcap with truth files NAME.npz. Each frame is matched by itself, with
the size that the matcher found over the first frames. Prints the table of docs/bank.md: the best
of shortlists by rendered depth; a shortlist of one is the paper's match, nearest in the subspace.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from bank_common import (
    RIGHT_M,
    Recording,
    find_scale,
    is_flipped,
    joints_of,
    load_recording,
    mean_error,
    recordings,
)
from command_line import make_parser

from depth_pose.bank import Bank
from depth_pose.core.config import MatchConfig
from depth_pose.steps.match import Matcher


def measure(bank: Bank, recorded: list[Recording], shortlist: int) -> dict[str, np.ndarray]:
    """Error (m), flip, score, best error of those kept (m), time (ms) and recording of every frame."""
    rows = []
    for number, recording in enumerate(recorded):
        scale = find_scale(bank, recording.people)
        matcher = Matcher(bank, MatchConfig(scale=scale, shortlist=shortlist, search_every=1))
        for people, known in zip(recording.people, recording.joints, strict=True):
            start = time.thread_time()
            matches = matcher.match(people)
            taken = time.thread_time() - start
            if not matches:
                continue
            (match,) = matches
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
    e, right = found["error"], found["error"] < RIGHT_M
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


def main() -> None:
    """Measure every bank on every recording."""
    parser = make_parser(__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("banks", nargs="+", metavar="LABEL=FILE")
    parser.add_argument("--step", type=int, default=3, help="use every so many frames")
    parser.add_argument("--shortlist", type=int, nargs="+", default=[1, 10, MatchConfig().shortlist])
    arguments = parser.parse_args()
    recorded = [load_recording(path, arguments.step) for path in recordings(arguments.data)]
    print(f"{sum(len(r.people) for r in recorded)} frames of {len(recorded)} recordings")
    print(
        f"{'bank, compared':28s} {'mean':>6s} {'median':>6s} {'flip %':>6s} {'right%':>6s} best-of-kept  ms"
    )
    for text in arguments.banks:
        label, _, file = text.partition("=")
        bank = Bank.load(file)
        for shortlist in arguments.shortlist:
            report(f"{label}, {shortlist}", measure(bank, recorded, shortlist), recorded)


if __name__ == "__main__":
    main()
