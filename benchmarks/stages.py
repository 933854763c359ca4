"""Processor time of every stage with both methods, single thread, at three sizes of image.

    python benchmarks/stages.py                    # simulated: 176x144, 320x240 and 640x480
    python benchmarks/stages.py a.mcap b.mcap --bank my_bank.npz

Prints a table in Markdown: milliseconds a frame, the median and in brackets the 10th and 90th percentile,
once the person's size is known; and the median while it is being found. `all.py` writes it, with the
comparisons, into BENCHMARK.md.
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import MatchConfig, PipelineConfig, RefineConfig
from depth_pose.core.types import DepthFrame
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline
from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.simulate import Stage, simulate

STAGES = ("denoise", "matcher", "refine", "recovery")
METHODS = ("articulated", "cpd")
SECONDS = 3.0


@dataclass(frozen=True)
class StageTimes:
    """Times (T, 4) of the stages on a recording with one method, milliseconds."""

    images: str
    method: str
    times: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """Times of the frames after the person's size was found; all where there are none."""
        first = MatchConfig().scale_frames
        return self.times[first:] if len(self.times) > first else self.times


def simulated(folder: Path) -> list[Path]:
    """Record the same motion with a time-of-flight camera, and with structured light in two sizes."""
    paths = []
    for name, width in (("tof", 176), ("structured", 320), ("structured", 640)):
        sensor = SENSORS[name].with_width(width)
        paths.append(folder / f"{name}_{width}.mcap")
        clip = load_motion("play", sensor.fps, SECONDS)
        simulate(paths[-1], Person().body(), clip, Stage(sensor=sensor))
    return paths


def measure(pipeline: PosePipeline, frames: list[DepthFrame]) -> np.ndarray:
    """Processor time of each stage on each frame, shape (T, 4), milliseconds."""
    pipeline.reset()
    times = np.empty((len(frames), len(STAGES)))
    for i, frame in enumerate(frames):
        marks = [time.thread_time()]
        people = pipeline.extractor.extract(frame)
        marks.append(time.thread_time())
        matches = pipeline.matcher.match(people)
        marks.append(time.thread_time())
        refined = pipeline.refiner.refine(people, matches)
        marks.append(time.thread_time())
        answers = pipeline.recoverer.recover(people, refined)
        marks.append(time.thread_time())
        pipeline.refiner.take_answer(answers)
        times[i] = 1e3 * np.diff(marks)
    return times


def measure_all(bank: Bank, recordings: Sequence[Path]) -> list[StageTimes]:
    """Run both methods over recordings."""
    measured = []
    for method in METHODS:
        pipeline = PosePipeline(bank, PipelineConfig(refine=RefineConfig(method=method)))
        pipeline.warm_up()
        for path in recordings:
            frames = list(DepthReader(path))
            camera = frames[0].camera
            pipeline.process_frame(frames[0])
            times = measure(pipeline, frames)
            measured.append(StageTimes(f"{camera.width}x{camera.height}", method, times))
    return measured


def _cell(values: np.ndarray) -> str:
    low, middle, high = np.percentile(values, [10, 50, 90])
    return f"{middle:.1f} ({low:.1f}-{high:.1f})"


def table(measured: list[StageTimes]) -> str:
    """Lay out the times in Markdown."""
    lines = [
        "| images | method | " + " | ".join(STAGES) + " | **sum** | sum, first frames |",
        "|---" * (len(STAGES) + 4) + "|",
    ]
    for m in measured:
        first = m.times[: MatchConfig().scale_frames].sum(axis=1)
        cells = [_cell(m.known[:, k]) for k in range(len(STAGES))]
        total = f"**{_cell(m.known.sum(axis=1))}**"
        lines.append(f"| {m.images} | {m.method} | {' | '.join(cells)} | {total} | {np.median(first):.1f} |")
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--bank", type=Path, help="exemplar bank; the set-up's by default")
    arguments = parser.parse_args()
    bank = Bank.load(arguments.bank or default_bank_path())
    with tempfile.TemporaryDirectory() as folder:
        print(table(measure_all(bank, arguments.recordings or simulated(Path(folder)))))


if __name__ == "__main__":
    main()
