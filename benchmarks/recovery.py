"""Failure detection and recovery, measured on simulated clips.

    python benchmarks/recovery.py detection --bank BANK --clips CLIP.mcap ...
    python benchmarks/recovery.py held-out -o recovery.png
    python benchmarks/recovery.py normal --bank BANK --clips CLIP.mcap ...

``detection``: inserts simulated failures (`depth_pose.sim.failures`) into right skeletons of clips
with known joints; counts how many are detected, and how many right skeletons are taken for failures.
The thresholds were chosen on the even clips; the odd ones are the test.
``held-out``: uses a bank without the families of low postures, and clips of those; error with and without
recovery over the frames in which a failure is detected, as the paper's Fig. 13. ``--without`` and
``--motions`` select other families.
``normal``: what recovery changes in clips that need none.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from depth_pose.bank import Bank, build_bank, default_bank_path
from depth_pose.bank.build import BuildConfig
from depth_pose.body.pose import Fitted
from depth_pose.body.procedural import make_body
from depth_pose.core.config import PipelineConfig, RecoverConfig, RefineConfig, SmoothConfig
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import Source
from depth_pose.io.mcap_read import read_frames
from depth_pose.motion.procedural.generator import make_poses
from depth_pose.pipeline import FrameResult, PosePipeline
from depth_pose.recover.failure import FailureCheck
from depth_pose.recover.tuning import RecoverTuning
from depth_pose.refine.tuning import RefineTuning
from depth_pose.sim.config import Person
from depth_pose.sim.failures import KINDS, fail
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import simulate
from depth_pose.tuning import Tuning

LOW = ("squats", "bends", "sit_down", "lunges", "balance")
"""Families of low postures, which standing ones do not cover."""

RIGHT_M, WRONG_M = 0.06, 0.2
"""A skeleton is right if its mean error is below the first, a failure moves a joint by the second."""


def simulated(names: list[str], folder: Path) -> list[Path]:
    """Simulate procedural motions of a person whose body differs from the bank's."""
    paths = []
    for name in names:
        path = folder / f"{name}.mcap"
        if not path.is_file():
            simulate(path, Person().body(), load_motion(name, 25.0, 10.0, seed=3), seed=3)
        paths.append(path)
    return paths


def known_joints(path: Path) -> np.ndarray:
    """Joints (T, 19, 3) of the truth file beside a recording."""
    return np.load(path.with_suffix(".npz"))["joints"]


def run(
    bank: Bank, path: Path, method: str, track: bool, recover: bool
) -> tuple[list[FrameResult], list[str]]:
    """Return every stage's results, and recovery's reasons for each failure."""
    config = PipelineConfig(refine=RefineConfig(method=method), smooth=SmoothConfig(enabled=False))
    tuning = Tuning(refine=RefineTuning(track=track), recover=RecoverTuning(enabled=recover))
    pipeline, results, reasons = PosePipeline(bank, config, tuning), [], []
    for frame in read_frames(path):
        results.append(pipeline.process_frame(frame))
        reasons.append("; ".join(pipeline.recoverer.last_reasons.values()))
    return results, reasons


def error_mm(answer: Skeleton | Fitted, known: np.ndarray) -> float:
    """Mean joint error, millimetres; NaN where the person is lost."""
    if answer.is_lost:
        return float("nan")
    joints = answer.joints if isinstance(answer, Fitted) else answer.positions
    return 1e3 * float(np.linalg.norm(joints - known, axis=1).mean())


def detection(bank: Bank, paths: list[Path]) -> None:
    """Count detected failures and false alarms, clip by clip, and print them."""
    check, rng = FailureCheck(bank.body, RecoverConfig().min_confidence), np.random.default_rng(0)
    counts = {part: {k: [0, 0] for k in ("right", *KINDS)} for part in ("chosen on", "tested on")}
    for number, path in enumerate(paths):
        known, (results, _) = known_joints(path), run(bank, path, "articulated", True, False)
        part = counts["tested on" if number % 2 else "chosen on"]
        fits = [next(iter(r.refined), None) for r in results]
        right = [
            fit is not None and error_mm(fit, k) < 1e3 * RIGHT_M for fit, k in zip(fits, known, strict=True)
        ]
        for t in range(1, len(results)):
            if not (right[t - 1] and right[t]):
                continue
            good, now = fits[t - 1], fits[t]
            part["right"][0] += check.find(now, good, good) is not None
            part["right"][1] += 1
            if t % 5:
                continue
            for kind in KINDS:
                wrong = fail(kind, now, results[t].people.persons[0], bank, rng)
                if np.linalg.norm(wrong.joints - known[t], axis=1).max() < WRONG_M:
                    continue
                part[kind][0] += check.find(wrong, good, good) is not None
                part[kind][1] += 1
    for part, rows in counts.items():
        found, all_ = (sum(rows[k][i] for k in KINDS) for i in (0, 1))
        alarms = rows["right"]
        precision = found / max(found + alarms[0] * all_ / max(alarms[1], 1), 1)
        print(f"{part}: recall {found}/{all_} = {found / max(all_, 1):.3f}, ", end="")
        print(f"false alarms {alarms[0]}/{alarms[1]} = {alarms[0] / max(alarms[1], 1):.3f}, ", end="")
        print(f"precision where half the frames fail {precision:.3f}")
        print("   ", ", ".join(f"{k} {rows[k][0]}/{rows[k][1]}" for k in KINDS))


def held_out(
    names: list[str], methods: list[str], without: list[str], poses: int, output: Path, folder: Path
) -> None:
    """Compare with and without recovery on clips whose families the bank lacks; draw the first clip."""
    bank_path = folder / f"without_{'_'.join(without)}_{poses}.npz"
    if not bank_path.is_file():
        made = make_poses(2 * poses, seed=1)
        kept = np.flatnonzero([family not in without for family in made.families])
        kept = kept[:: max(1, len(kept) // poses)][:poses]
        build_bank(make_body(), made.rotations[kept], BuildConfig(), {"without": without}).save(bank_path)
    bank = Bank.load(bank_path)
    curves = []
    for method, track in [(m, t) for m in methods for t in (False, True)]:
        for path in simulated(names, folder):
            known = known_joints(path)
            plain = [r.skeleton for r in run(bank, path, method, track, False)[0]]
            results, reasons = run(bank, path, method, track, True)
            before = np.array([error_mm(s, k) for s, k in zip(plain, known, strict=True)])
            after = np.array([error_mm(r.skeleton, k) for r, k in zip(results, known, strict=True)])
            hit = np.array([bool(reason) for reason in reasons]) & np.isfinite(before + after)
            recovered = sum(r.skeleton.source == Source.RECOVERED for r in results)
            label = f"{method}{'' if track else ', each frame for itself'}"
            ratio = after[hit].mean() / before[hit].mean() if hit.any() else 1.0
            print(
                f"{path.stem:10s} {label:34s} all {np.nanmean(before):6.1f} -> {np.nanmean(after):6.1f} mm, "
                f"{hit.sum():3d} affected {before[hit].mean():6.1f} -> {after[hit].mean():6.1f} mm "
                f"= {ratio:.2f}, {recovered} recovered, {np.isnan(after).sum()} lost",
                flush=True,
            )
            if path.stem == names[0]:
                curves.append((label, before, after, hit))
    _draw(curves, names[0], output)


def _draw(curves: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]], name: str, output: Path) -> None:
    figure, axes = plt.subplots(
        len(curves), 1, figsize=(9, 2.2 * len(curves)), sharex=True, layout="constrained"
    )
    for axis, (label, before, after, hit) in zip(axes, curves, strict=True):
        axis.fill_between(np.arange(len(hit)), 0, 1, hit, color="0.92", transform=axis.get_xaxis_transform())
        axis.plot(before, color="tab:red", lw=1, label="without recovery")
        axis.plot(after, color="tab:blue", lw=1, label="with recovery")
        axis.set(ylabel="mean error, mm", title=label, ylim=(0, None), xlim=(0, len(hit) - 1))
        axis.title.set_fontsize(9)
    axes[0].legend(loc="upper right", fontsize=8)
    axes[-1].set_xlabel(f"frame of a clip of {name}, whose family the bank lacks (grey: a failure is found)")
    figure.savefig(output, dpi=110)


def normal(bank: Bank, paths: list[Path]) -> None:
    """Print what recovery changes in clips that need none."""
    changes = []
    for path in paths:
        known = known_joints(path)
        means = []
        for recover in (False, True):
            skeletons = [r.skeleton for r in run(bank, path, "articulated", True, recover)[0]]
            means.append(np.nanmean([error_mm(s, k) for s, k in zip(skeletons, known, strict=True)]))
        changes.append(means[1] - means[0])
        print(f"{path.stem:18s} {means[0]:6.1f} -> {means[1]:6.1f} mm ({changes[-1]:+.2f})", flush=True)
    print(f"mean change {np.mean(changes):+.2f} mm, largest {max(changes):+.2f}, least {min(changes):+.2f}")


def main() -> None:
    """Run the chosen part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("detection", "held-out", "normal"))
    parser.add_argument("--clips", nargs="+", type=Path, help="recordings with their .npz beside them")
    parser.add_argument("--bank", type=Path, default=None)
    parser.add_argument("--without", nargs="+", default=list(LOW))
    parser.add_argument("--motions", nargs="+", default=["bends", "squats", "balance"])
    parser.add_argument("--methods", nargs="+", default=["articulated", "cpd"])
    parser.add_argument("--poses", type=int, default=2000)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "depth_pose_recovery")
    parser.add_argument("-o", "--output", type=Path, default=Path("recovery.png"))
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.what == "held-out":
        a = arguments
        held_out(a.motions, a.methods, a.without, a.poses, a.output, a.folder)
        return
    bank = Bank.load(arguments.bank or default_bank_path())
    clips = arguments.clips or simulated(
        ["walk", "wave", "play", "squats", "kick", "signals"], arguments.folder
    )
    {"detection": detection, "normal": normal}[arguments.what](bank, clips)


if __name__ == "__main__":
    main()
