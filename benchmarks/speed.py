"""Measure the speed of all stages and of other tools: writes docs/speed.md and its plot.

    pip install -e '.[bench]'                             # pycpd
    python benchmarks/speed.py
    python benchmarks/speed.py a.mcap --bank my_bank.npz  # prints the stages on recordings of yours, no more

Takes a few minutes on one core. Reads nothing but the bank: the recordings are simulated.
"""

from __future__ import annotations

import one_thread  # noqa: F401

# isort: split
import datetime
import os
import platform
import tempfile
from importlib.metadata import version
from pathlib import Path

import numpy as np
from command_line import make_parser
from parts import cpd, peers, stages

from depth_pose.bank import Bank, default_bank_path
from depth_pose.match.tuning import MatchTuning

ROOT = Path(__file__).resolve().parents[1]
"""The repository."""

TEXT = """# Speed

Written by `python benchmarks/speed.py` on {date}: {machine}. One thread;
milliseconds of processor time.

![Milliseconds by stage, and beside other tools](images/stages.png)

## The pipeline

A simulated person, {seconds:g} s at the sensor's rate: time of flight (176x144), structured light (320x240,
640x480), both in a room; and one, three and six who walk about in furnished rooms (320x240, 15 frames a
second). Stages are means, sums medians with the 10th and 90th percentile, once the first sizes are known; the
last column is the first {first} frames, which find the sizes. People are those answered.
Bank: {poses:,} poses from {views} views each.

{stages}

## Beside other tools

The same inputs in the same run; `benchmarks/parts/peers.py` says what each does.

{peers}

## Coherent point drift

{source} vertices to {target} points, 27 iterations, the same settings for all but the last two rows;
`benchmarks/parts/cpd.py` says more. The residual is the mean distance to the nearest target point. The
Laplacian completion of the body's mesh, factorised anew for each frame, takes {laplacian:.1f} ms.

{cpd}

[Accuracy](accuracy.md#what-each-part-is-worth) says what each part is worth in millimetres and milliseconds;
[Small computers](small_computers.md) what to expect of slower processors.
"""


def machine() -> str:
    """Processor, cores and versions."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line.split(":", 1)[1].strip() for line in info.open() if line.startswith("model name")]
        model = names[0] if names else model
    packages = ", ".join(f"{name} {version(name)}" for name in ("numba", "numpy"))
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}, {packages}"


def draw(measured: list[stages.StageTimes], compared: list[peers.Peer], path: Path) -> None:
    """Draw the stages as stacked bars, and the comparisons."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 5), layout="constrained")
    left, right = figure.subplots(1, 2)
    names = [f"{m.images}, {m.people.max()}, {m.method}" for m in measured]
    rows, start = np.arange(len(measured)), np.zeros(len(measured))
    for k, stage in enumerate(stages.STAGES):
        wide = np.array([np.mean(m.known[:, k]) for m in measured])
        left.barh(rows, wide, left=start, label=stage)
        start += wide
    for y, total in enumerate(start):
        left.text(total + 0.5, y, f"{total:.0f}", va="center", fontsize=8)
    left.set(xlabel="ms of processor time a frame, means", title="the pipeline, one thread")
    left.set_yticks(rows, names, fontsize=7)
    left.set_xlim(0, 1.1 * start.max())
    left.invert_yaxis()
    left.legend(fontsize=8, loc="upper right")
    labels = [f"{p.step.split(',')[0]}: {p.name}" for p in compared]
    colors = ["tab:green" if "ours" in p.name else "0.6" for p in compared]
    right.barh(labels, [p.ms for p in compared], color=colors)
    for y, p in enumerate(compared):
        right.text(p.ms * 1.1, y, f"{p.ms:.1f}", va="center", fontsize=8)
    right.set(xscale="log", xlabel="ms, log scale", title="beside other tools, same input")
    right.set_xlim(0.3, 4 * max(p.ms for p in compared))
    right.tick_params(axis="y", labelsize=7)
    right.invert_yaxis()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure everything and write the page."""
    parser = make_parser(__doc__)
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--bank", type=Path, help="exemplar bank; the set-up's by default")
    parser.add_argument(
        "-o", "--output", type=Path, default=ROOT, help="the folder that docs/speed.md goes to"
    )
    arguments = parser.parse_args()
    bank = Bank.load(arguments.bank or default_bank_path())
    if arguments.recordings:
        print(stages.table(stages.measure_all(bank, arguments.recordings)))
        return
    with tempfile.TemporaryDirectory() as folder:
        print("stages ...", flush=True)
        measured = stages.simulated_all(bank, Path(folder))
    print("other tools ...", flush=True)
    compared = peers.compare_all(bank)
    print("coherent point drift ...", flush=True)
    registered = cpd.compare()
    text = TEXT.format(
        date=datetime.date.today(),
        machine=machine(),
        seconds=stages.SECONDS,
        first=MatchTuning().scale_frames,
        poses=bank.poses,
        views=bank.coefficients.shape[1],
        stages=stages.table(measured),
        peers=peers.table(compared),
        source=cpd.SOURCE,
        target=cpd.TARGET,
        laplacian=cpd.completion_time(),
        cpd=cpd.table(registered),
    )
    (arguments.output / "docs" / "images").mkdir(parents=True, exist_ok=True)
    (arguments.output / "docs" / "speed.md").write_text(text)
    bars = [p for p in compared if p.ms] + [
        peers.Peer("CPD", r.name, r.ms, "") for r in registered if "pipeline" not in r.name
    ]
    draw(measured, bars, arguments.output / "docs" / "images" / "stages.png")
    print(text)


if __name__ == "__main__":
    main()
