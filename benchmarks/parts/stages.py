"""Processor time of every stage, single thread: three image sizes, all methods; one, three, six people.

A table in Markdown: milliseconds a frame once the first sizes are known, means of the stages, and the sum's
median with the 10th and 90th percentile; last the sum's median while sizes are being found. ``finder`` is the
learned people finder, ``joint net`` the net that measures joints, ``denoise`` the locally optimal projection,
and ``tracks`` the rest of the first stage: masks, ids, floor, views. A person's share is the sum divided by
the number of people answered, the finder included.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from depth_pose import perception
from depth_pose.bank import Bank
from depth_pose.core.config import PipelineConfig, RefineConfig, SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.denoise.denoise import denoise_depth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.match.tuning import MatchTuning
from depth_pose.pipeline import PosePipeline
from depth_pose.sim.clips import sample_clip, write_clip
from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.simulate import Stage, simulate

STAGES = ("finder", "joint net", "denoise", "tracks", "matcher", "refine", "recovery")
METHODS = {
    "articulated": PipelineConfig(),
    "speed: high": PipelineConfig(segment=SegmentConfig(speed="high")),
    "cpd": PipelineConfig(refine=RefineConfig(method="cpd")),
}
"""The default, with high speed, and the paper's registration."""

SECONDS = 3.0
"""Of each clip."""

ROOMS = ((1, 11), (3, 12), (6, 88))
"""People in a simulated room, and a seed with which all of them are in view; the weights of the finder were
trained with other seeds."""

ROOM_FPS, ROOM_WIDTH_PX = 15.0, 320
"""Frame rate (Hz) and image width of the rooms."""


@dataclass(frozen=True)
class StageTimes:
    """Times of the stages on a recording with one method.

    Attributes
    ----------
    images, method : str
    times : (T, 7) float64
        Milliseconds, in the order of `STAGES`.
    people : (T,) int
        Number of people answered.
    """

    images: str
    method: str
    times: np.ndarray
    people: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """Times of the frames after the first sizes were found; all where there are none."""
        return self.times[self.first :]

    @property
    def first(self) -> int:
        """Number of frames that find sizes; 0 where there are no others."""
        frames = MatchTuning().scale_frames
        return frames if len(self.times) > frames else 0


def simulated(folder: Path) -> list[Path]:
    """Record the same motion with a time-of-flight camera, and with structured light in two sizes."""
    paths = []
    for name, width in (("tof", 176), ("structured", 320), ("structured", 640)):
        sensor = SENSORS[name].with_width(width)
        paths.append(folder / f"{name}_{width}.mcap")
        clip = load_motion("play", sensor.fps, SECONDS)
        simulate(paths[-1], Person().body(), clip, Stage(sensor=sensor))
    return paths


def simulated_rooms(folder: Path) -> list[Path]:
    """Record one, three and six people who walk about in rooms: ``depth-pose simulate --room``."""
    paths = []
    for people, seed in ROOMS:
        paths.append(folder / f"room_{people}.mcap")
        frames = round(SECONDS * ROOM_FPS)
        clip = sample_clip(np.random.default_rng(seed), frames, ROOM_FPS, people, ROOM_WIDTH_PX)
        write_clip(paths[-1], clip)
    return paths


class Timed:
    """A function that sums its processor time, seconds."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self.seconds = 0.0

    def __call__(self, *arguments: Any) -> Any:
        """Call the function."""
        begin = time.thread_time()
        result = self._function(*arguments)
        self.seconds += time.thread_time() - begin
        return result


@contextmanager
def timed_parts(pipeline: PosePipeline) -> Iterator[tuple[Timed, ...]]:
    """Time the finder, the joint nets and the denoising of the first stage."""
    segmenter = pipeline.perception.segmenter
    finder = segmenter.candidates.finder
    parts = Timed(finder.find), Timed(segmenter._look_at), Timed(perception.denoise_depth)
    finder.find, segmenter._look_at, perception.denoise_depth = parts
    try:
        yield parts
    finally:
        del finder.find, segmenter._look_at
        perception.denoise_depth = denoise_depth


def measure(pipeline: PosePipeline, frames: list[DepthFrame]) -> tuple[np.ndarray, np.ndarray]:
    """Measure each stage on each frame, (T, 7), milliseconds of processor time, and people answered, (T,)."""
    pipeline.reset()
    times, people = np.empty((len(frames), len(STAGES))), np.empty(len(frames), int)
    with timed_parts(pipeline) as parts:
        for i, frame in enumerate(frames):
            times[i], people[i] = _measure_frame(pipeline, frame, parts)
    return times, people


def _measure_frame(
    pipeline: PosePipeline, frame: DepthFrame, parts: Sequence[Timed]
) -> tuple[np.ndarray, int]:
    for part in parts:  # not every frame is searched
        part.seconds = 0.0
    marks = [time.thread_time()]
    people = pipeline.perception.perceive(frame)
    marks.append(time.thread_time())
    matches = pipeline.matcher.match(people)
    marks.append(time.thread_time())
    refined = pipeline.refiner.refine(people, matches)
    marks.append(time.thread_time())
    answers = pipeline.recoverer.recover(people, refined)
    marks.append(time.thread_time())
    first, *others = np.diff(marks)
    seconds = [part.seconds for part in parts]
    return 1e3 * np.array([*seconds, first - sum(seconds), *others]), len(answers)


def measure_all(
    bank: Bank, recordings: Sequence[Path], methods: Sequence[str] = tuple(METHODS)
) -> list[StageTimes]:
    """Run some of `METHODS` over recordings."""
    measured = []
    for method in methods:
        pipeline = PosePipeline(bank, METHODS[method])
        pipeline.warm_up()
        for path in recordings:
            frames = list(DepthReader(path))
            camera = frames[0].camera
            pipeline.process_frame(frames[0])
            times = measure(pipeline, frames)
            where = ", a room" if path.stem.startswith("room") else ""
            measured.append(StageTimes(f"{camera.width}x{camera.height}{where}", method, *times))
    return measured


def _cell(values: np.ndarray) -> str:
    low, middle, high = np.percentile(values, [10, 50, 90])
    return f"{middle:.1f} ({low:.1f}-{high:.1f})"


def table(measured: list[StageTimes]) -> str:
    """Format the times in Markdown."""
    lines = [
        "| images | people | method | " + " | ".join(STAGES) + " | **sum** | a person | sum, first frames |",
        "|---" * (len(STAGES) + 6) + "|",
    ]
    for m in measured:
        total, people = m.known.sum(axis=1), m.people[m.first :]
        first = np.median(m.times[: MatchTuning().scale_frames].sum(axis=1))
        share = np.median(total[people > 0] / people[people > 0]) if people.any() else np.nan
        cells = [m.images, f"{people.mean():.1f}", m.method]
        cells += [f"{value:.1f}" for value in np.mean(m.known, axis=0)]
        cells += [f"**{_cell(total)}**", f"{share:.1f}", f"{first:.1f}"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def simulated_all(bank: Bank, folder: Path) -> list[StageTimes]:
    """Measure the simulated recordings: one person with all methods, rooms without the slowest."""
    rooms = [method for method in METHODS if method != "cpd"]
    return measure_all(bank, simulated(folder)) + measure_all(bank, simulated_rooms(folder), rooms)
