"""Processor time of every stage, single thread, on recordings or on simulated ones.

    python benchmarks/stages.py                    # simulated: 176x144 and 640x480
    python benchmarks/stages.py a.mcap b.mcap --bank my_bank.npz

Prints a table in Markdown: median milliseconds a frame while the person's size is being found, and
after that.
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from depth_pose.bank import Bank, default_bank_path
from depth_pose.config import MatchConfig
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline
from depth_pose.types import DepthFrame

STAGES = ("denoise", "matcher", "refine", "recovery")


def measure(pipeline: PosePipeline, frames: list[DepthFrame]) -> np.ndarray:
    """Processor time of each stage on each frame, shape (T, 4), milliseconds."""
    pipeline.reset()
    times = np.empty((len(frames), len(STAGES)))
    for i, frame in enumerate(frames):
        marks = [time.thread_time()]
        cloud = pipeline.extractor.extract(frame)
        marks.append(time.thread_time())
        match = pipeline.matcher.match(cloud)
        marks.append(time.thread_time())
        refined = pipeline.refiner.refine(cloud, match)
        marks.append(time.thread_time())
        pipeline.recoverer.recover(cloud, refined)
        marks.append(time.thread_time())
        times[i] = 1e3 * np.diff(marks)
    return times


def simulated(folder: str) -> Iterator[Path]:
    """Make a recording of each of the simulator's sensors."""
    for sensor in ("tof", "structured"):
        path = Path(folder) / f"{sensor}.mcap"
        command = [sys.executable, "-m", "depth_pose.cli", "simulate", "--sensor", sensor]
        subprocess.run([*command, "--seconds", "3", "-o", str(path)], check=True, stdout=subprocess.DEVNULL)
        yield path


def row(name: str, times: np.ndarray) -> str:
    cells = [*np.median(times, axis=0), np.median(times.sum(axis=1))]
    return f"| {name} | " + " | ".join(f"{c:.1f}" for c in cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--bank", type=Path, default=None)
    arguments = parser.parse_args()
    pipeline = PosePipeline(Bank.load(arguments.bank or default_bank_path()))
    pipeline.warm_up()
    first = MatchConfig().scale_frames
    print("| recording, ms of CPU a frame | " + " | ".join(STAGES) + " | sum |")
    print("|---" * (len(STAGES) + 2) + "|")
    with tempfile.TemporaryDirectory() as folder:
        for path in arguments.recordings or simulated(folder):
            frames = list(DepthReader(path))
            camera = frames[0].camera
            times = measure(pipeline, frames)
            name = f"{path.stem} {camera.width}x{camera.height}"
            print(row(f"{name}, first {first} frames", times[:first]))
            if len(times) > first:
                print(row(f"{name}, then", times[first:]))


if __name__ == "__main__":
    main()
