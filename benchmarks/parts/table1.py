"""The paper's Table 1 and its ablation (Fig. 10), on recordings with known joints.

    python benchmarks/accuracy.py table1 DATA --bank my_bank.npz -o docs/images
    python benchmarks/accuracy.py table1 DATA --bank embedded=a.npz recorded=b.npz --step 3

DATA is a folder of recordings with truth files beside them (``NAME.mcap``, ``NAME.npz``); those of
time-of-flight sensors (at most 200 pixels wide) are taken. For each bank and each method it gives the share
of joints within 2 to 20 cm beside the paper's Table 1, and the mean error and the shares

with all                 the pipeline as it is
without denoising        the person's raw points: no projection, no outliers dropped
without refinement       the matcher's best exemplar where it was placed
nearest, unrefined       the exemplar nearest in the subspace (eq. 6), as the paper takes it

With ``--step`` only every n-th frame is run. A frame without an answer counts as a miss in the shares.
Prints the tables and draws ``table1.png`` and ``ablation.png``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import DenoiseConfig, PipelineConfig, RefineConfig
from depth_pose.core.skeleton import JOINTS
from depth_pose.denoise.tuning import DenoiseTuning
from depth_pose.evaluate.score import THRESHOLDS_M
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.match.tuning import MatchTuning
from depth_pose.pipeline import PosePipeline
from depth_pose.tuning import Tuning
from parts.known_people import joints_of, make_matcher, recordings

PAPER = (0.36, 0.57, 0.79, 0.89, 0.95, 0.98, 0.99)
SHOTTON = (0.02, 0.06, 0.30, 0.53, 0.73, 0.82, 0.85)
"""Table 1: the paper's method (the first), and that of its reference 21, on another data set."""

METHODS = ("articulated", "cpd")
RAW = DenoiseConfig(iterations=0), Tuning(denoise=DenoiseTuning(outlier_distance=1.0))
"""Denoising that changes nothing."""


@dataclass(frozen=True)
class Errors:
    """Distances (T, 19) of one recording's joints, metres; NaN without an answer."""

    clip: str
    distances: np.ndarray


Variant = list[Errors]


def shares(variant: Variant) -> np.ndarray:
    """Share of joints within each threshold."""
    distances = np.concatenate([e.distances for e in variant])
    return np.array([(distances < t).mean() for t in THRESHOLDS_M])


def mean_mm(variant: Variant) -> float:
    """Mean error over answered joints, millimetres."""
    return 1e3 * float(np.nanmean(np.concatenate([e.distances for e in variant])))


def run(bank: Bank, paths: list[Path], method: str, step: int) -> dict[str, Variant]:
    """Run all variants over the recordings; those without refinement once."""
    refine = RefineConfig(method=method)
    pipelines = {
        f"{method}, all": PosePipeline(bank, PipelineConfig(refine=refine)),
        f"{method}, no denoising": PosePipeline(bank, PipelineConfig(refine=refine, denoise=RAW[0]), RAW[1]),
    }
    nearest = make_matcher(bank, MatchTuning(shortlist=1, keep=1, keep_unmeasured=1, search_every=1))
    found: dict[str, Variant] = {name: [] for name in (*pipelines, "no refinement", "nearest, unrefined")}
    for path in paths:
        truth = load_truth(path.with_suffix(".npz"))
        rows: dict[str, list[np.ndarray]] = {name: [] for name in found}
        for pipeline in pipelines.values():
            pipeline.reset()
        nearest.reset()
        for frame in list(DepthReader(path))[::step]:
            known = truth.joints[int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))]
            for k, (name, pipeline) in enumerate(pipelines.items()):
                result = pipeline.process_frame(frame)
                lost = result.skeleton.is_lost
                rows[name].append(_off(None if lost else result.skeleton.positions, known))
                if k == 0 and method == METHODS[0]:
                    for label, matches in (
                        ("no refinement", result.matches),
                        ("nearest, unrefined", nearest.match(result.people)),
                    ):
                        mine = (m for m in matches if m.body_id == result.skeleton.body_id)
                        match = next(mine, None)
                        rows[label].append(_off(joints_of(bank, match) if match else None, known))
        for name, part in rows.items():
            if part:
                found[name].append(Errors(path.stem, np.array(part)))
        print(f"{method}: {path.stem} done", flush=True)
    return {name: variant for name, variant in found.items() if variant}


def _off(joints: np.ndarray | None, known: np.ndarray) -> np.ndarray:
    return np.full(len(JOINTS), np.nan) if joints is None else np.linalg.norm(joints - known, axis=1)


def table1(measured: dict[str, dict[str, Variant]]) -> str:
    """Format the shares of the whole pipelines in Markdown."""
    lines = ["| within | " + " | ".join(f"{100 * t:.0f} cm" for t in THRESHOLDS_M) + " | mean mm |"]
    lines.append("|---" * (len(THRESHOLDS_M) + 2) + "|")
    rows = {"the paper (Table 1)": PAPER, "its reference 21": SHOTTON}
    for name, row in rows.items():
        lines.append(f"| {name} | {' | '.join(f'{v:.2f}' for v in row)} | {'38' if row is PAPER else ''} |")
    for bank, variants in measured.items():
        for name, variant in variants.items():
            if name.endswith(", all"):
                cells = " | ".join(f"{v:.3f}" for v in shares(variant))
                lines.append(
                    f"| {name.removesuffix(', all')}, {bank} bank | {cells} | {mean_mm(variant):.1f} |"
                )
    return "\n".join(lines)


def ablation(measured: dict[str, dict[str, Variant]]) -> str:
    """Format the variants in Markdown: mean error of all, within 10 cm, and by recording."""
    clips = [e.clip for e in next(iter(next(iter(measured.values())).values()))]
    lines = ["| bank | variant | mean mm | within 10 cm | " + " | ".join(clips) + " |"]
    lines.append("|---" * (len(clips) + 4) + "|")
    for bank, variants in measured.items():
        for name, variant in variants.items():
            cells = " | ".join(f"{mean_mm([e]):.0f}" for e in variant)
            within = shares(variant)[THRESHOLDS_M.index(0.10)]
            lines.append(f"| {bank} | {name} | {mean_mm(variant):.1f} | {within:.3f} | {cells} |")
    return "\n".join(lines)


def draw_table1(measured: dict[str, dict[str, Variant]], path: Path) -> None:
    """Draw the shares against the distance."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.add_subplot()
    at = 100 * np.array(THRESHOLDS_M)
    axes.plot(at, PAPER, "ks-", label="the paper, Table 1 (other data)")
    axes.plot(at, SHOTTON, "s-", color="0.6", label="its reference 21 (other data)")
    fine = np.linspace(0, 0.2, 201)
    for bank, variants in measured.items():
        for name, variant in variants.items():
            if name.endswith(", all"):
                distances = np.concatenate([e.distances for e in variant])
                axes.plot(
                    100 * fine,
                    [(distances < t).mean() for t in fine],
                    label=f"{name.removesuffix(', all')}, {bank} bank: {mean_mm(variant):.0f} mm",
                )
    axes.set(xlabel="distance, cm", ylabel="share of joints within", xlim=(0, 20.3), ylim=(0, 1.01))
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)
    figure.savefig(path, dpi=110)


def draw_ablation(variants: dict[str, Variant], bank: str, path: Path) -> None:
    """Draw the mean error of every recording, variant beside variant."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.add_subplot()
    clips = [e.clip.removeprefix("dev_") for e in next(iter(variants.values()))]
    places, wide = np.arange(len(clips) + 1), 0.8 / len(variants)
    for k, (name, variant) in enumerate(variants.items()):
        heights = [*(mean_mm([e]) for e in variant), mean_mm(variant)]
        bars = axes.bar(places + (k - 0.5 * (len(variants) - 1)) * wide, heights, wide, label=name)
        axes.bar_label(bars, [f"{h:.0f}" for h in heights], fontsize=6)
    axes.set_xticks(places, [*clips, "all"])
    axes.set(ylabel="mean joint error, mm", title=f"{bank} bank")
    axes.legend(fontsize=8, ncols=2)
    axes.set_ylim(0, 1.25 * axes.get_ylim()[1])
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run, print and draw."""
    parser = make_parser(__doc__)
    parser.add_argument("data", type=Path, help="folder of recordings with truth files")
    parser.add_argument("--bank", nargs="*", metavar="[LABEL=]FILE", help="the set-up's by default")
    parser.add_argument("--step", type=int, default=1, help="run every n-th frame")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("-o", "--output", type=Path, default=Path(), help="folder for the pictures")
    arguments = parser.parse_args()
    files = arguments.bank or [str(default_bank_path())]
    paths = recordings(arguments.data)
    measured: dict[str, dict[str, Variant]] = {}
    for text in files:
        label, _, file = text.rpartition("=")
        bank, label = Bank.load(file), label or "embedded"
        measured[label] = {}
        for method in arguments.methods:
            measured[label] |= run(bank, paths, method, arguments.step)
    print("\n" + table1(measured) + "\n\n" + ablation(measured))
    arguments.output.mkdir(parents=True, exist_ok=True)
    draw_table1(measured, arguments.output / "table1.png")
    first = next(iter(measured))
    draw_ablation(measured[first], first, arguments.output / "ablation.png")
