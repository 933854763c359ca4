"""Constants: each one of the stages after detection halved and doubled, and what that changes.

    python benchmarks/accuracy.py constants DATA --frames 20
    python benchmarks/accuracy.py constants DATA --only refine.solver recover

DATA is a folder of recordings with truth files. Every number of `depth_pose.tuning.Tuning`, and every number
in a module of match, refine and recover that is no kernel, is a row: the change of the mean joint error
(mm), of the share of joints within 10 cm (a frame without an answer is a miss) and of the processor time of
a frame (ms), for half and for double. Detection runs once. Constants that kernels have compiled in do not
change here.
"""

from __future__ import annotations

import pkgutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import PipelineConfig
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline
from depth_pose.track.person_view import FramePeople
from depth_pose.tuning import Tuning

FOLDERS = ("match", "refine", "recover")
Clip = list[tuple[FramePeople, np.ndarray]]
"""The people of each frame, and their true joints."""


def tuned() -> Iterator[tuple[str, str, str, float]]:
    """Give the numbers of the tuning: name, stage, field and value."""
    for stage, values in Tuning()._asdict().items():
        for field, value in values._asdict().items():
            if stage not in ("detect", "denoise") and type(value) in (int, float) and value:
                yield f"{stage}.{field}", stage, field, value


def constants() -> Iterator[tuple[str, ModuleType, str, float]]:
    """Give the numbers in modules: name, module, variable and value."""
    for folder in FOLDERS:
        package = import_module(f"depth_pose.{folder}")
        for found in pkgutil.iter_modules(package.__path__):
            if not found.name.endswith("kernels"):
                module = import_module(f"depth_pose.{folder}.{found.name}")
                for name, value in vars(module).items():
                    if name.isupper() and type(value) in (int, float) and value:
                        yield f"{folder}.{found.name}.{name}", module, name, value


@contextmanager
def changed(module: ModuleType, name: str, value: float) -> Iterator[None]:
    """Give a module's variable another value for a while."""
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


def perceive(pipeline: PosePipeline, path: Path, most: int) -> Clip:
    """Find the people in the first frames of a recording."""
    truth, clip = load_truth(path.with_suffix(".npz")), []
    pipeline.restart()
    for _, frame in zip(range(most), DepthReader(path), strict=False):
        known = truth.joints[int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))]
        clip.append((pipeline.perception.perceive(frame), known))
    return clip


def run(pipeline: PosePipeline, clips: list[Clip]) -> np.ndarray:
    """Return the mean error (mm), the share within 10 cm, and the processor time of a frame (ms)."""
    errors, seconds = [], 0.0
    for clip in clips:
        pipeline.reset()
        for people, known in clip:
            fresh = replace(people, persons=tuple(replace(p) for p in people.persons))
            start = time.process_time()
            skeleton = pipeline.answer(fresh).skeleton
            seconds += time.process_time() - start
            off = np.full(len(known), np.nan)
            errors.append(off if skeleton.is_lost else np.linalg.norm(skeleton.positions - known, axis=1))
    found = np.array(errors)
    return np.array([1e3 * np.nanmean(found), (found < 0.1).mean(), 1e3 * seconds / len(found)])


def main() -> None:
    """Run and report."""
    parser = make_parser(__doc__)
    parser.add_argument("data", type=Path, help="folder of NAME.mcap with NAME.npz")
    parser.add_argument("--frames", type=int, default=20, help="of each recording, from its beginning")
    parser.add_argument("--only", nargs="*", default=[""], help="beginnings of names")
    arguments = parser.parse_args()
    bank = Bank.load(default_bank_path())
    whole = PosePipeline(bank)
    whole.warm_up()
    paths = [p for p in sorted(arguments.data.glob("*.mcap")) if p.with_suffix(".npz").exists()]
    clips = [perceive(whole, path, arguments.frames) for path in paths]
    base = run(whole, clips)
    print(f"{base[0]:.1f} mm, {base[1]:.3f} within 10 cm, {base[2]:.1f} ms a frame; with half, with double:")
    print("| | value | mm | within 10 cm | ms | mm | within 10 cm | ms |\n|---|---|---|---|---|---|---|---|")

    def report(name: str, value: float, rows: list[np.ndarray]) -> None:
        told = [f"{mm:+.1f} | {share:+.3f} | {ms:+.1f}" for mm, share, ms in np.array(rows) - base]
        print(f"| {name} | {value:g} | {' | '.join(told)} |", flush=True)

    def is_asked(name: str) -> bool:
        return name.startswith(tuple(arguments.only))

    for name, stage, field, value in tuned():
        if is_asked(name):
            rows = []
            for factor in (0.5, 2.0):
                values = getattr(Tuning(), stage)._replace(**{field: _times(value, factor)})
                pipeline = PosePipeline(bank, PipelineConfig(), Tuning()._replace(**{stage: values}))
                rows.append(run(pipeline, clips))
            report(name, value, rows)
    for name, module, variable, value in constants():
        if is_asked(name):
            rows = []
            for factor in (0.5, 2.0):
                with changed(module, variable, _times(value, factor)):
                    rows.append(run(PosePipeline(bank), clips))
            report(name, value, rows)


def _times(value: float, factor: float) -> float:
    return max(1, round(factor * value)) if isinstance(value, int) else factor * value
