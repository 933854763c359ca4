"""Evaluate the whole pipeline in unseen homes, paired: with a standing camera and with one that moves.

    python benchmarks/homes.py cameras build/homes         # six homes of 2 s for each of four sensors
    python benchmarks/homes.py cameras build/homes --homes 20 --sensor oak_d

The same home, people and pets are recorded twice. Recordings and skeletons are kept in the folder, so that an
interrupted run continues; delete ``skeletons`` in it after a change of the pipeline. Prints a table in
Markdown: who is found of those of whom .3 or more shows, false ones, ids that change, mean error, joints
within 10 cm.
"""

from __future__ import annotations

import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
from command_line import make_parser
from rich.progress import track

from depth_pose.evaluate.score_people import PeopleScore, score_people
from depth_pose.sim.clips import sample_clip, write_clip
from depth_pose.sim.sensor import SENSORS

SEED = 710_001
"""Training takes 1 to 3 and 900,001; the finder's benchmark 700,001."""
MODELS = ("xtion", "azure_kinect", "d435", "oak_d")
"""Sensors: structured light, time of flight, active and passive stereo."""
CAMERAS = ("standing", "moving")
FPS, SECONDS, WIDTH_PX = 15.0, 2.0, 320


def record(folder: Path, model: str, number: int) -> None:
    """Record a home by a standing and by a moving camera, unless that is done."""
    frames, people = round(FPS * SECONDS), number % 4
    for camera in CAMERAS:
        path = folder / camera / model / f"{number:03d}.mcap"
        if path.exists():
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        rng = np.random.default_rng([SEED, list(SENSORS).index(model), number])
        moves = camera == "moving"
        write_clip(path, sample_clip(rng, frames, FPS, people, WIDTH_PX, model=model, home=True, moves=moves))


def answered(folder: Path, camera: str, model: str) -> PeopleScore:
    """Run the pipeline over recordings without skeletons, and score all of this camera and sensor."""
    recordings, skeletons = folder / camera / model, folder / "skeletons" / camera / model
    command = [sys.executable, "-m", "depth_pose.cli", "run", f"{recordings}/", "-o", f"{skeletons}/"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return score_people(recordings, skeletons).total


def main() -> None:
    """Record, run and print."""
    parser = make_parser(__doc__)
    parser.add_argument("folder", type=Path, help="folder of recordings and skeletons")
    parser.add_argument("--homes", type=int, default=6, help="how many per sensor; one in four is empty")
    parser.add_argument("--sensor", choices=SENSORS, help="one sensor only")
    arguments = parser.parse_args()
    models = [arguments.sensor] if arguments.sensor else MODELS
    for model, number in track(list(product(models, range(arguments.homes))), "homes"):
        record(arguments.folder, model, number)
    print("| sensor | camera | frames | people | found | false | changes of id | mm | within 10 cm |")
    print("|---|---|---|---|---|---|---|---|---|")
    for model, camera in product(models, CAMERAS):
        s = answered(arguments.folder, camera, model)
        print(
            f"| {model} | {camera} | {s.frames} | {s.asked} | {s.recall:.3f} | {s.false} | {s.switches} | "
            f"{s.mean_error_mm:.0f} | {s.pck10:.3f} |",
            flush=True,
        )
