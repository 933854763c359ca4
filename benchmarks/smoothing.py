"""What the filter on the joints costs in lag, and what it gives.

    python benchmarks/smoothing.py                       # simulated clips
    python benchmarks/smoothing.py DATA/*.mcap --sweep   # recordings with truth files beside them

The pipeline runs over every clip without the filter; then the joints are filtered with each setting
(minimal cut-off in Hz : cut-off gained per speed in Hz s/m). Printed for each: mean error; jitter, the median
change of the error from frame to frame, of joints that truly move slower than 5 cm/s and of the others; and
the lag against the unfiltered joints by true speed. The lag is the delay that explains the difference best,

    sum v . (raw - filtered) / sum v . v,

with v the joint's true velocity. ``--sweep`` tries a grid of settings.
"""

from __future__ import annotations

import one_thread  # noqa: F401

# isort: split

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import PipelineConfig, SmoothConfig
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline
from depth_pose.recover.smooth import JointFilter
from depth_pose.sim.config import Person
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import simulate

MOTIONS = ("walk", "wave", "play", "kick", "signals", "squats")
SPEEDS = (0.0, 0.05, 0.25, 0.5, 1.0, 2.0, 20.0)
"""Bounds of the classes of true speed, m/s."""


@dataclass(frozen=True)
class Track:
    """One clip: stamps (T,) ns; joints without filter and true ones, (T, 19, 3), metres."""

    stamps_ns: np.ndarray
    raw: np.ndarray
    known: np.ndarray

    @property
    def velocity(self) -> np.ndarray:
        """True velocity, (T, 19, 3), metres a second."""
        return np.gradient(self.known, self.stamps_ns * 1e-9, axis=0)

    def filtered(self, config: SmoothConfig) -> np.ndarray:
        """Filter the joints."""
        joints = JointFilter(config)
        return np.array([joints.filter(p, int(t)) for p, t in zip(self.raw, self.stamps_ns, strict=True)])


@dataclass(frozen=True)
class Effect:
    """What a setting does: lags (6,) in ms, the rest in mm."""

    error: float
    still: float
    moving: float
    lags: np.ndarray


def simulated(folder: Path) -> list[Path]:
    """Simulate clips of a person who is not the bank's body."""
    paths = [folder / f"{name}.mcap" for name in MOTIONS]
    for path in paths:
        simulate(path, Person().body(), load_motion(path.stem, 25.0, 4.0, seed=5), seed=5)
    return paths


def track(pipeline: PosePipeline, path: Path) -> Track:
    """Run over a recording, without the filter; the longest run of answered frames."""
    truth, rows = load_truth(path.with_suffix(".npz")), []
    pipeline.reset()
    for frame in DepthReader(path):
        skeleton = pipeline.process_frame(frame).skeleton
        if skeleton.is_lost:
            rows.clear()
            continue
        known = truth.joints[int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))]
        rows.append((frame.stamp_ns, skeleton.positions, known))
    return Track(*(np.array(column) for column in zip(*rows, strict=True)))


def measure(tracks: Iterable[Track], config: SmoothConfig) -> Effect:
    """Filter, and compare."""
    error, still, moving = [], [], []
    over, under = np.zeros(len(SPEEDS) - 1), np.zeros(len(SPEEDS) - 1)
    for t in tracks:
        answer, v = t.filtered(config), t.velocity
        speed = np.linalg.norm(v, axis=2)
        off = answer - t.known
        error.append(np.linalg.norm(off, axis=2).ravel())
        shake = np.linalg.norm(np.diff(off, axis=0), axis=2)
        rests = np.maximum(speed[1:], speed[:-1]) < SPEEDS[1]
        still.append(shake[rests])
        moving.append(shake[~rests])
        late = np.einsum("tjk,tjk->tj", v, t.raw - answer)
        for k, (low, high) in enumerate(pairwise(SPEEDS)):
            mine = (speed >= low) & (speed < high)
            over[k] += late[mine].sum()
            under[k] += (speed[mine] ** 2).sum()

    def median(parts: list[np.ndarray]) -> float:
        return 1e3 * float(np.median(np.concatenate(parts)))

    lags = 1e3 * over / np.maximum(under, 1e-9)
    return Effect(1e3 * float(np.concatenate(error).mean()), median(still), median(moving), lags)


def table(tracks: list[Track], settings: Iterable[SmoothConfig]) -> str:
    """Lay out the effects of settings in Markdown."""
    bounds = [f"{low:g}-{high:g}" for low, high in pairwise(SPEEDS[1:-1])] + [f"over {SPEEDS[-2]:g}"]
    lines = [
        "| cut-off | error mm | jitter at rest mm | in motion mm | "
        + " | ".join(f"lag ms at {b} m/s" for b in bounds)
        + " |",
        "|---" * (4 + len(bounds)) + "|",
    ]
    for config in settings:
        e = measure(tracks, config)
        name = f"{config.min_cutoff:g} : {config.beta:g}" if config.enabled else "no filter"
        lags = " | ".join(f"{lag:.0f}" for lag in e.lags[1:])
        lines.append(f"| {name} | {e.error:.2f} | {e.still:.2f} | {e.moving:.2f} | {lags} |")
    return "\n".join(lines)


def main() -> None:
    """Track, filter and print."""
    parser = make_parser(__doc__)
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--bank", type=Path, help="exemplar bank; the set-up's by default")
    parser.add_argument("--sweep", action="store_true", help="try a grid of settings")
    arguments = parser.parse_args()
    bank = Bank.load(arguments.bank or default_bank_path())
    pipeline = PosePipeline(bank, PipelineConfig(smooth=SmoothConfig(enabled=False)))
    pipeline.warm_up()
    with tempfile.TemporaryDirectory() as folder:
        paths = arguments.recordings or simulated(Path(folder))
        tracks = [track(pipeline, path) for path in paths]
    settings = [SmoothConfig(enabled=False), SmoothConfig()]
    if arguments.sweep:
        settings += [
            SmoothConfig(min_cutoff=m, beta=b)
            for m in (0.5, 1.0, 1.5, 2.5, 4.0)
            for b in (4.0, 8.0, 16.0, 32.0)
        ]
    rests = sum(int((np.linalg.norm(t.velocity, axis=2) < SPEEDS[1]).sum()) for t in tracks)
    print(f"{sum(len(t.raw) for t in tracks)} frames of {len(tracks)} clips, {rests} joints at rest")
    print(table(tracks, settings))


if __name__ == "__main__":
    main()
