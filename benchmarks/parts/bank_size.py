"""Error and time against the size of the bank (the paper's Fig. 14).

    python benchmarks/banks.py size DATA embedded=a.npz recorded=b.npz --pictures docs/images

Every 1st, 4th, 16th and 64th pose of each bank. Each frame stands alone: matched with the body scale
that the matcher found over the first frames, and refined without the previous pose.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank
from depth_pose.match.search import SubspaceSearch
from depth_pose.match.tuning import MatchTuning
from parts.known_people import Recording, compare_frames, find_scale, read_arguments, subsample

SHARES = (1, 4, 16, 64)
"""Every n-th pose is kept."""
COLUMNS = ("poses", "match mm", "flips %", "refined mm", "flips %", "match ms", "search ms")


def measure(bank: Bank, recorded: list[Recording], scales: list[float]) -> list[float]:
    """Compute a row of the table: the figures of `COLUMNS`."""
    table = np.concatenate([compare_frames(bank, r, s) for r, s in zip(recorded, scales, strict=True)])
    errors = table[:, :4].mean(axis=0) * (1e3, 1e2, 1e3, 1e2)
    return [bank.poses, *errors.tolist(), 1e3 * float(np.median(table[:, 4])), search_time(bank)]


def search_time(bank: Bank, repeats: int = 30) -> float:
    """Milliseconds of one exact search of the whole subspace (eq. 6), one thread."""
    table = bank.coefficients.reshape(-1, bank.coefficients.shape[-1])
    search = SubspaceSearch(table)
    times = []
    for k in range(repeats):
        point = table[k * len(table) // repeats] + np.float32(0.1)
        start = time.thread_time()
        search.find(point, MatchTuning().shortlist)
        times.append(time.thread_time() - start)
    return 1e3 * float(np.median(times))


def draw(tables: dict[str, np.ndarray], path: Path) -> None:
    """Draw error and time against the number of poses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.8), layout="constrained")
    error, times = figure.subplots(1, 2)
    for colour, (label, table) in zip(("tab:blue", "tab:orange", "tab:green"), tables.items(), strict=False):
        error.plot(table[:, 0], table[:, 1], "o--", color=colour, label=f"{label}, best match")
        error.plot(table[:, 0], table[:, 3], "o-", color=colour, label=f"{label}, refined")
        times.plot(table[:, 0], table[:, 5], "o-", color=colour, label=f"{label}, matching")
        times.plot(table[:, 0], table[:, 6], "o:", color=colour, label=f"{label}, search alone")
    error.set(ylabel="mean joint error (mm)", ylim=(0, None))
    times.set(ylabel="ms per frame, one thread", ylim=(0, None))
    for axes in (error, times):
        axes.set(xscale="log", xlabel="poses in the bank")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure every size of every bank."""
    parser = make_parser(__doc__)
    parser.add_argument("--pictures", type=Path)
    arguments, recorded = read_arguments(parser, step=8)
    print(f"{'bank':12s}" + " ".join(f"{name:>10s}" for name in COLUMNS))
    tables = {}
    for text in arguments.banks:
        label, _, file = text.partition("=")
        whole = Bank.load(file)
        scales = [find_scale(whole, r.people) for r in recorded]
        rows = []
        for share in SHARES:
            rows.append(measure(subsample(whole, share), recorded, scales))
            print(f"{label:12s}" + " ".join(f"{figure:10.1f}" for figure in rows[-1]), flush=True)
        tables[label] = np.array(rows)
    if arguments.pictures:
        draw(tables, arguments.pictures / "bank_size.png")
