"""Error of matching and refinement against the view (the paper's Fig. 11), on simulated walking.

    python benchmarks/banks.py views BANK --pictures docs/images

The views of Fig. 11 are the front, the camera rolled by 30 degrees, and from the upper right
looking down; then eight azimuths all around, and elevations from -15 to 60 degrees. The simulated
person's build is not the bank's, and the sensor's noise is that of the time-of-flight model. Each
frame stands alone: matched, and refined without the previous pose.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank
from depth_pose.body.body import Body
from depth_pose.core.skeleton import ADULT_STATURE_M
from depth_pose.motion.clip import Clip
from depth_pose.sim.config import Person, Placement, Room
from depth_pose.sim.motion import load_motion
from depth_pose.sim.simulate import Stage, simulate
from parts.known_people import Recording, compare_frames, load_recording
from parts.random_people import aimed

_DISTANCE_M = 3.6
"""Distance from the camera to the point that it looks at, metres. Set by hand."""


@dataclass(frozen=True)
class Result:
    """Mean error of matches and of refinements (m), and their shares of flips, over a view's frames."""

    matched: float
    matched_flips: float
    refined: float
    refined_flips: float
    frames: int

    def __str__(self) -> str:
        return (
            f"match {1e3 * self.matched:5.0f} mm, flips {100 * self.matched_flips:4.1f} %; refined "
            f"{1e3 * self.refined:5.0f} mm, flips {100 * self.refined_flips:4.1f} %; {self.frames} frames"
        )


def placement(azimuth: float = 0.0, elevation: float = 0.0, roll: float = 0.0) -> Placement:
    """Build a camera 3.6 m from the middle of the body, which it looks at."""
    return aimed(_DISTANCE_M, elevation, azimuth, roll, lowest=0.06)


def on_the_spot(clip: Clip) -> Clip:
    """Walk as on a treadmill, so that every view shows the whole person."""
    return Clip(clip.name, clip.fps, clip.rotations, clip.roots * np.array([0.0, 1.0, 0.0]))


def watch(body: Body, clip: Clip, place: Placement, folder: Path, step: int) -> Recording:
    """Simulate a view and extract its people."""
    path = folder / "view.mcap"
    simulate(path, body, clip, Stage(placement=place, room=Room(floor=False, wall=0.0)))
    return load_recording(path, step)


def measure(bank: Bank, recording: Recording, scale: float) -> Result:
    """Match and refine every frame by itself."""
    rows = compare_frames(bank, recording, scale)
    return Result(*rows[:, :4].mean(axis=0).tolist(), frames=len(rows))


def draw(
    named: dict[str, Result], around: dict[float, Result], above: dict[float, Result], path: Path
) -> None:
    """Draw the three views' errors, and the error and flips against azimuth and elevation."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 3.8), layout="constrained")
    bars, turn, tilt = figure.subplots(1, 3)
    at = np.arange(len(named))
    bars.bar(at - 0.2, [1e3 * r.matched for r in named.values()], 0.4, label="best match")
    bars.bar(at + 0.2, [1e3 * r.refined for r in named.values()], 0.4, label="refined")
    bars.set_xticks(at, list(named), fontsize=8)
    bars.set_ylabel("mean joint error (mm)")
    bars.margins(y=0.3)
    bars.legend(loc="upper left")
    for axes, rows, name in ((turn, around, "azimuth (degrees)"), (tilt, above, "elevation (degrees)")):
        axes.plot(list(rows), [1e3 * r.matched for r in rows.values()], "o-", label="best match")
        axes.plot(list(rows), [1e3 * r.refined for r in rows.values()], "o-", label="refined")
        axes.set(xlabel=name, ylabel="mean joint error (mm)", ylim=(0, None))
        flips = axes.twinx()
        flips.bar(
            list(rows),
            [100 * r.refined_flips for r in rows.values()],
            width=0.04 * np.ptp(list(rows)),
            alpha=0.3,
            color="tab:red",
        )
        flips.set(ylabel="flips after refinement (%)", ylim=(0, 100))
        axes.grid(alpha=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Simulate every view and measure."""
    parser = make_parser(__doc__)
    parser.add_argument("bank", type=Path)
    parser.add_argument("--motion", default="walk", help="a procedural motion or a .bvh file")
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--step", type=int, default=4, help="use every n-th frame")
    parser.add_argument("--only", choices=("named", "around", "above"), nargs="+")
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    bank = Bank.load(arguments.bank)
    body = Person().body()
    scale = body.stature / ADULT_STATURE_M
    clip = on_the_spot(load_motion(arguments.motion, 25.0, arguments.seconds, seed=5))
    named = {"front": placement(), "roll of 30": placement(roll=30.0), "upper right": placement(-40.0, 35.0)}
    views = {
        "named": named,
        "around": {a: placement(float(a)) for a in range(0, 360, 45)},
        "above": {e: placement(20.0, float(e)) for e in (-15, 0, 15, 30, 45, 60)},
    }
    results: dict[str, dict] = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind, places in views.items():
            results[kind] = {}
            for name, place in places.items() if kind in (arguments.only or views) else ():
                recording = watch(body, clip, place, Path(folder), arguments.step)
                results[kind][name] = result = measure(bank, recording, scale)
                print(f"{kind:7s} {name!s:12s} {result}", flush=True)
    if arguments.pictures:
        draw(results["named"], results["around"], results["above"], arguments.pictures / "bank_views.png")
