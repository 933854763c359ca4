"""Error and flips of the best match alone, single frames.

    python benchmarks/banks.py match DATA embedded=a.npz recorded=b.npz

DATA holds recordings NAME.mcap with truth files NAME.npz. Each frame is matched by itself, with
the body scale that the matcher found over the first frames. Prints a table: the best
of shortlists by rendered depth; a shortlist of one is the paper's match, nearest in the subspace.
"""

from __future__ import annotations

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank
from depth_pose.match.tuning import MatchTuning
from parts.known_people import (
    RIGHT_M,
    Recording,
    find_scale,
    is_flipped,
    joints_of,
    match_frames,
    mean_error,
    read_arguments,
)


def measure(bank: Bank, recorded: list[Recording], shortlist: int) -> dict[str, np.ndarray]:
    """Error (m), flip, score, best error of the shortlist (m), time (ms) and recording of every frame."""
    rows = []
    for number, recording in enumerate(recorded):
        scale = find_scale(bank, recording.people)
        for _, known, match, taken in match_frames(bank, recording, scale, shortlist):
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
    parser.add_argument("--shortlist", type=int, nargs="+", default=[1, 10, MatchTuning().shortlist])
    arguments, recorded = read_arguments(parser, step=3)
    print(
        f"{'bank, compared':28s} {'mean':>6s} {'median':>6s} {'flip %':>6s} {'right%':>6s} best-of-kept  ms"
    )
    for text in arguments.banks:
        label, _, file = text.partition("=")
        bank = Bank.load(file)
        for shortlist in arguments.shortlist:
            report(f"{label}, {shortlist}", measure(bank, recorded, shortlist), recorded)
