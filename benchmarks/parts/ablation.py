"""Ablation: the whole pipeline, and with one part left out at a time.

    python benchmarks/accuracy.py ablation --clips 12
    python benchmarks/accuracy.py ablation --data DATA --bank mine=my_bank.npz

Runs over simulated people of other builds than the bank's (those of the part ``confidence``: both
sensors, views and motions at random), or over a folder of recordings with truth files. Prints, for each
variant, the mean joint error in mm, the share of joints within 10 cm (a frame without an answer is a miss)
and the processor time of a frame, as a table in Markdown. With ``--bank`` other banks are rows of the table
as well: a bank of some motions only shows the value of the others.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.bank.build import BuildConfig, build_bank
from depth_pose.core.config import DenoiseConfig, MatchConfig, PersonalConfig, PipelineConfig, SmoothConfig
from depth_pose.denoise.tuning import DenoiseTuning
from depth_pose.detect.tuning import DetectTuning
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.match.tuning import MatchTuning
from depth_pose.motion.procedural.generator import POSTURE_SHARES, make_poses
from depth_pose.pipeline import PosePipeline
from depth_pose.recover.tuning import RecoverTuning
from depth_pose.refine.tuning import FitTuning, RefineTuning
from depth_pose.tuning import Tuning
from parts.confidence import simulated
from parts.known_people import recordings

VARIANTS: dict[str, tuple[PipelineConfig, Tuning]] = {
    "all": (PipelineConfig(), Tuning()),
    "no personal build": (PipelineConfig(build=PersonalConfig(personal=False)), Tuning()),
    "no denoising": (PipelineConfig(denoise=DenoiseConfig(iterations=0)), Tuning()),
    "no filter": (PipelineConfig(smooth=SmoothConfig(enabled=False)), Tuning()),
    "no learned joints: the paper's way": (PipelineConfig(match=MatchConfig(method="exemplars")), Tuning()),
} | {
    name: (PipelineConfig(), tuning)
    for name, tuning in {
        "no pull to the joint net's joints": Tuning(fit=FitTuning(proposal_weight=0.0)),
        "no pose of the frame before": Tuning(refine=RefineTuning(track=False)),
        "no points removed as outliers": Tuning(denoise=DenoiseTuning(outlier_distance=10.0)),
        "no free space in the fit": Tuning(fit=FitTuning(free_space_weight=0.0)),
        "no pose prior": Tuning(fit=FitTuning(prior=0.0)),
        "no recovery": Tuning(recover=RecoverTuning(enabled=False)),
        "a search for exemplars in every frame": Tuning(match=MatchTuning(search_every=1)),
        "a search for people in every frame": Tuning(detect=DetectTuning(find_every=1)),
    }.items()
}
"""The whole pipeline, and variants without one part."""
NO_POSTURES = "no seated, lying, kneeling ... postures in the bank"


def without_postures(bank: Bank) -> Bank:
    """Rebuild the bank from the embedded poses without the everyday postures."""
    poses = make_poses(bank.poses, seed=1)
    plain = np.flatnonzero([family not in POSTURE_SHARES for family in poses.families])
    return build_bank(bank.body, poses.take(plain).rotations, BuildConfig(), {"without": "postures"})


def make_pipelines(banks: dict[str, Bank]) -> dict[str, PosePipeline]:
    """Build the pipelines of all variants: for the first bank all, for others the whole pipeline."""
    first = next(iter(banks.values()))
    pipelines = {name: PosePipeline(first, *variant) for name, variant in VARIANTS.items()}
    pipelines[NO_POSTURES] = PosePipeline(without_postures(first))
    for name, bank in list(banks.items())[1:]:
        pipelines[f"bank {name}"] = PosePipeline(bank)
    return pipelines


def run(pipeline: PosePipeline, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Compute joint errors (F, 19), metres, NaN without an answer, and processor times (F,), seconds."""
    errors, times = [], []
    truth = load_truth(path.with_suffix(".npz"))
    pipeline.restart()
    for frame in DepthReader(path):
        start = time.process_time()
        skeleton = pipeline.process_frame(frame).skeleton
        times.append(time.process_time() - start)
        known = truth.joints[int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))]
        off = np.full(len(known), np.nan)
        errors.append(off if skeleton.is_lost else np.linalg.norm(skeleton.positions - known, axis=1))
    return np.array(errors), np.array(times)


def main() -> None:
    """Run and report."""
    parser = make_parser(__doc__)
    parser.add_argument("--clips", type=int, default=12, help="simulated clips")
    parser.add_argument("--data", type=Path, help="recordings with truth files instead")
    parser.add_argument("--bank", nargs="*", default=[], metavar="NAME=FILE", help="more banks")
    arguments = parser.parse_args()
    banks = {"": Bank.load(default_bank_path())}
    for text in arguments.bank:
        name, _, file = text.partition("=")
        banks[name] = Bank.load(file)
    pipelines = make_pipelines(banks)
    next(iter(pipelines.values())).warm_up()
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {name: [] for name in pipelines}
    with tempfile.TemporaryDirectory() as folder:
        clips = recordings(arguments.data, 10_000) if arguments.data else ()
        for path in clips or simulated(Path(folder), arguments.clips, []):
            for name, pipeline in pipelines.items():
                found[name].append(run(pipeline, path))
            print(f"{path.stem} done", flush=True)
    print("| | mm | within 10 cm | ms a frame |\n|---|---|---|---|")
    for name, parts in found.items():
        errors, times = (np.concatenate(column) for column in zip(*parts, strict=True))
        share, middle = (errors < 0.1).mean(), 1e3 * np.median(times)
        print(f"| {name} | {1e3 * np.nanmean(errors):.1f} | {share:.3f} | {middle:.0f} |")
