"""Check the deviations that the joint net states with its joints, by sensor, by distance, on recordings.

    python benchmarks/accuracy.py deviations                      # simulated people before several sensors
    python benchmarks/accuracy.py deviations --check DATA [DATA ...]

Of the net's own distributions .70 lie within one deviation in the image plane (root mean square of both
directions) and .76 in depth; of normal ones .63 and .68. Printed are the shares of the joints that do, and
the factor on all deviations with which the net's shares would.

Simulated are people in furnished rooms, by family of sensors and distance, and people of other builds than
the bank's who stand alone, two clips for each sensor and distance. Recordings are
as for ``accuracy.py proposals``; in those with joints in the image, only the plane is checked, without the
folder's median offset, and a joint counts at its proposed distance.
"""

from __future__ import annotations

import itertools
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.core.config import DenoiseConfig, MountConfig, SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.evaluate.overlay import project
from depth_pose.evaluate.truth import load_known_people
from depth_pose.io.mcap_read import DepthReader
from depth_pose.motion.procedural.generator import CLIPS
from depth_pose.perception import Perception
from depth_pose.sim.clips import sample_clip
from depth_pose.sim.motion import load_motion
from depth_pose.sim.scene_noise import FAMILIES
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.simulate import Stage, simulate
from parts.proposals import CUT_OUT, has_truth
from parts.random_people import aimed, person_of

SHARES = (0.70, 0.76)
"""Shares of the net's distributions within one deviation, in the plane and in depth."""
DISTANCES = (1.8, 2.6, 3.4, 4.2)
CLIPS_EACH, FRAMES, SEED = 2, 20, 515
ROOM_FRAMES, ROOM_FPS, ROOM_DISTANCES = 8, 6.0, (2.0, 3.0, 4.0)
SHOWN = 0.3
"""Least visible share of a person in a room."""
FAR_M = 0.4
"""A person whose proposals are farther from the truth, on average, is another one."""
FAR_PX = 0.35
"""The same on recordings with joints in the image, in heights of the joints' box."""


def found_in(path: Path) -> Iterator[tuple]:
    """Yield each frame with the people found in it who have proposals."""
    perception = Perception(SegmentConfig(), DenoiseConfig(), MountConfig())
    for frame in DepthReader(path):
        people = perception.perceive(frame).persons
        yield frame, [p.measured for p in people if p.measured is not None]


def against_truth(path: Path) -> np.ndarray:
    """Errors in deviations, in the plane and in depth, of all joints of a recording with a truth file."""
    truth, off = load_known_people(path.with_suffix(".npz")), [np.zeros((0, 2))]
    for frame, people in found_in(path):
        nearest = int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))
        for joints in truth.joints[nearest]:
            gaps = [float(np.linalg.norm(p.places - joints, axis=1).mean()) for p in people]
            if gaps and min(gaps) < FAR_M:
                off.append(in_deviations(people[int(np.argmin(gaps))], joints))
    return np.concatenate(off)


def in_deviations(measured: JointMeasurement, joints: np.ndarray) -> np.ndarray:
    """Errors (19, 2) of proposals, across their rays and along them."""
    places, sigma = measured.places.astype(float), measured.sigma.astype(float)
    ray = places / np.linalg.norm(places, axis=1, keepdims=True)
    deep = ((places - joints) * ray).sum(axis=1)
    across = np.linalg.norm(places - joints - deep[:, None] * ray, axis=1)
    return np.column_stack([across / np.sqrt(2.0), np.abs(deep)]) / sigma


def against_image(path: Path) -> np.ndarray:
    """Offsets in the image (n, 2), in deviations, of all joints of a recording with joints in pixels."""
    out = [np.zeros((0, 2))]
    for (frame, people), persons in zip(found_in(path), known_in_image(path), strict=True):
        for joints in persons if people else ():
            rows, places = [JOINT_INDEX[n] for n in joints], np.array([uv[:2] for uv in joints.values()])
            offsets = [project(p.places.astype(float), frame.camera)[rows] - places for p in people]
            gaps = [float(np.median(np.linalg.norm(o, axis=1))) for o in offsets]
            best = int(np.argmin(gaps))
            if gaps[best] < FAR_PX * max(float(np.ptp(places[:, 1])), 1.0):
                deep, sigma = people[best].places[rows, 2], people[best].sigma[rows, 0]
                out.append(offsets[best] * (deep / (frame.camera.fx * sigma))[:, None])
    return np.concatenate(out)


def known_in_image(path: Path) -> Iterator[list[dict[str, list[float]]]]:
    """Yield the joints in pixels of the people in each frame."""
    if path.with_name(CUT_OUT).exists():
        yield from ([joints] for joints in json.loads(path.with_name(CUT_OUT).read_text()))
        return
    known = {f["stamp_ns"]: f["persons"] for f in json.loads(path.with_suffix(".json").read_text())}
    for frame in DepthReader(path):
        persons = known.get(frame.stamp_ns, [])
        yield [p["joints"] for p in persons if p["joints"] and not p.get("ignore")]


def report(label: str, off: np.ndarray) -> None:
    """Print one row of the table; ``off`` has one column where only the plane is known."""
    cells = []
    for share, column in zip(SHARES, off.T, strict=False):
        cells.append(f"{(column < 1.0).mean():.2f} | {np.quantile(column, share):.2f}")
    print(f"| {label} | {len(off)} | {' | '.join(cells)} |", flush=True)


def in_rooms(family: str, number: int) -> Iterator[tuple[float, np.ndarray]]:
    """Yield distances, metres, and errors in deviations, (19, 2), of people in a furnished room."""
    rng = np.random.default_rng([SEED, FAMILIES.index(family), number])
    clip = sample_clip(rng, ROOM_FRAMES, ROOM_FPS, people=1 + number % 2, sensor=family)
    perception = Perception(SegmentConfig(), DenoiseConfig(), MountConfig())
    for t in range(ROOM_FRAMES):
        frame = DepthFrame(int(clip.stamps_ns[t]), "", clip.depth[t], clip.camera)
        people = [p.measured for p in perception.perceive(frame).persons if p.measured is not None]
        for joints in clip.joints[t][clip.visible[t] > SHOWN]:
            gaps = [float(np.linalg.norm(p.places - joints, axis=1).mean()) for p in people]
            if gaps and min(gaps) < FAR_M:
                nearest = people[int(np.argmin(gaps))]
                yield float(nearest.places[:, 2].mean()), in_deviations(nearest, joints)


def simulated(folder: Path, sensor: str, distance: float) -> Iterator[Path]:
    """Simulate people before one kind of sensor at one distance, from all around."""
    model, names = SENSORS[sensor], sorted(CLIPS)
    for k in range(CLIPS_EACH):
        rng = np.random.default_rng([SEED, k, round(10 * distance)])
        build = rng.uniform(-1.0, 1.0, 8)
        person = person_of(1.65 + 0.27 * build[0], build[1:])
        place = aimed(distance, rng.uniform(-5, 15), rng.uniform(-180, 180))
        clip = load_motion(names[rng.integers(len(names))], model.fps, FRAMES / model.fps, seed=k)
        path = folder / f"{sensor}{k}.mcap"
        simulate(path, person.body(), clip, Stage(model, place), seed=k)
        yield path
        path.unlink()


def main() -> None:
    """Run and report."""
    parser = make_parser(__doc__)
    parser.add_argument("--check", type=Path, nargs="+", help="folders of recordings, in place of simulation")
    parser.add_argument("--sensors", nargs="+", choices=sorted(SENSORS), default=sorted(SENSORS))
    parser.add_argument("--rooms", type=int, default=60, help="furnished rooms for each family of sensors")
    arguments = parser.parse_args()
    print("| | joints | in the plane | factor | in depth | factor |\n|---|---|---|---|---|---|")
    for data in arguments.check or ():
        paths = sorted(data.glob("*.mcap"))
        if known := [path for path in paths if has_truth(path)]:
            report(data.name, np.concatenate([against_truth(path) for path in known]))
            continue
        shown = [p for p in paths if p.with_suffix(".json").exists() or p.with_name(CUT_OUT).exists()]
        if not shown:
            parser.error(f"--check {data}: no NAME.mcap with a reference beside it")
        off = np.concatenate([against_image(path) for path in shown])
        off = np.sqrt(((off - np.median(off, axis=0)) ** 2).mean(axis=1))
        report(data.name, off[:, None])
    if arguments.check:
        return
    for family in FAMILIES:
        seen = [one for number in range(arguments.rooms) for one in in_rooms(family, number)]
        away = np.digitize([distance for distance, _ in seen], ROOM_DISTANCES)
        for n, (near, far) in enumerate(itertools.pairwise((0.0, *ROOM_DISTANCES, np.inf))):
            some = [off for (_, off), k in zip(seen, away, strict=True) if k == n]
            report(f"rooms, {family}, {near:g} to {far:g} m", np.concatenate([np.zeros((0, 2)), *some]))
        report(f"rooms, {family}", np.concatenate([off for _, off in seen]))
    everything: dict[str, list[np.ndarray]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for sensor in arguments.sensors:
            for distance in DISTANCES:
                off = [against_truth(path) for path in simulated(Path(folder), sensor, distance)]
                everything.setdefault(sensor, []).extend(off)
                everything.setdefault(f"{distance} m", []).extend(off)
    for label, off in everything.items():
        report(label, np.concatenate(off))
