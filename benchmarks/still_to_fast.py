"""Somebody stands still and then moves fast: what resting costs, in millimetres.

    python benchmarks/still_to_fast.py            # 6 simulated clips, about a minute
    python benchmarks/still_to_fast.py --clips 24

In each clip a person holds a pose for two seconds, then continues a motion at its fastest moment. The same
clip is processed with ``segment.speed`` low (everybody is measured and fitted in every frame), normal and
high. Prints the mean error of all joints while the person is still, in the first 100 ms of the motion, and in
the 500 ms after, the share of still frames in which the person was taken for calm, and their processor time.
"""

from __future__ import annotations

import one_thread  # noqa: F401

# isort: split
import tempfile
import time
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import PipelineConfig, SegmentConfig
from depth_pose.io.mcap_read import read_frames
from depth_pose.motion.clip import Clip
from depth_pose.pipeline import PosePipeline
from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.simulate import Stage, simulate

MOTIONS = ("throw", "kick", "punch", "jump", "racket", "wave")
"""Procedural motions, in turn."""

STILL_S, FIRST_S, AFTER_S = 2.0, 0.1, 0.5
"""Length of the rest, and of the two parts of the motion that follow, seconds."""

SPEEDS = ("low", "normal", "high")


def still_then_fast(motion: str, fps: float, seed: int) -> Clip:
    """Return a motion that begins at its fastest moment, after a rest in the pose of that moment."""
    clip = load_motion(motion, fps, 8.0, seed)
    still, moving = round(STILL_S * fps), round((FIRST_S + AFTER_S) * fps)
    way = np.linalg.norm(np.diff(clip.nodes(), axis=0), axis=2).mean(axis=1)
    start = int(way[: len(clip) - moving].argmax())
    rows = np.concatenate([np.full(still, start), np.arange(start + 1, start + 1 + moving)])
    return Clip(clip.name, fps, clip.rotations[rows], clip.roots[rows])


def run(pipeline: PosePipeline, path: Path, joints: np.ndarray) -> np.ndarray:
    """Return the error (mm), whether the person is calm, and the time (ms) of each frame, (3, T)."""
    pipeline.restart()
    found = np.full((3, len(joints)), np.nan)
    for t, frame in enumerate(read_frames(path)):
        started = time.thread_time()
        result = pipeline.process_frame(frame)
        found[2, t] = 1e3 * (time.thread_time() - started)
        if result.skeletons:
            found[0, t] = 1e3 * np.linalg.norm(result.skeletons[0].positions - joints[t], axis=1).mean()
            found[1, t] = result.people.persons[0].found.is_calm
    return found


def main() -> None:
    """Measure, and print a table."""
    parser = make_parser(__doc__)
    parser.add_argument("--clips", type=int, default=6, help="number of clips")
    parser.add_argument("--sensor", choices=SENSORS, default="structured")
    given = parser.parse_args()
    clips, sensor, bank = given.clips, SENSORS[given.sensor].with_width(320), Bank.load(default_bank_path())
    pipelines = [PosePipeline(bank, PipelineConfig(segment=SegmentConfig(speed=speed))) for speed in SPEEDS]
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(clips):
            path = Path(folder) / f"{number}.mcap"
            clip = still_then_fast(MOTIONS[number % len(MOTIONS)], sensor.fps, number)
            joints = simulate(path, Person().body(), clip, Stage(sensor=sensor), number).joints
            found.append([run(pipeline, path, joints) for pipeline in pipelines])
    errors, calm, times = np.array(found).transpose(2, 1, 0, 3)  # each by speed, clip and frame
    still, first = round(STILL_S * sensor.fps), round(FIRST_S * sensor.fps)
    rest, begin, after = slice(still // 2, still), slice(still, still + first), slice(still + first, None)
    print("| segment.speed | still | first 100 ms | 500 ms after | calm while still | ms a still frame |")
    print("|---" * 6 + "|")
    for s, speed in enumerate(SPEEDS):
        cells = [f"{np.nanmean(errors[s][:, part]):.1f}" for part in (rest, begin, after)]
        cells += [f"{np.nanmean(calm[s][:, rest]):.2f}", f"{times[s][:, rest].mean():.1f}"]
        print(f"| {speed} | {' | '.join(cells)} |")
    print(f"\n{clips} clips; frames without a skeleton: {[int(np.isnan(e).sum()) for e in errors]}")


if __name__ == "__main__":
    main()
