"""Evaluate the whole pipeline in unseen homes: who is found, and how well, by what is seen of them.

    python benchmarks/homes.py views                                   # 100 homes, some minutes
    python benchmarks/homes.py views --homes 500 --results a.jsonl     # continues an interrupted run

In each home nobody moves; the pipeline sees `FRAMES` frames, a tenth of a second apart, and the last one
counts. A person is asked for if .3 or more of them shows, and found by the skeleton whose joints lie within
.4 m on average; a skeleton of nobody of whom .05 shows is false. Sensors of the four families take turns,
mountings are random. Prints a table in Markdown: found, false ones a home, overlap of masks (median), mean
error, joints within 10 cm of all asked; then the calibration of the person's probability by sensor.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from command_line import make_parser
from rich.progress import track

from depth_pose.bank.bank import Bank, default_bank_path
from depth_pose.core.frame import DepthFrame
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.pipeline import FrameResult, PosePipeline
from depth_pose.sim.home_scenes import furnished_home
from depth_pose.sim.home_sensors import HOME_FAMILIES
from depth_pose.sim.materials import WORN
from depth_pose.sim.scenes import Scene, render
from depth_pose.track.person_odds import PersonOdds

SEED = 720_001
"""Training takes 1 to 3, 41 and 900,001; the other benchmarks 700,001 and 710,001."""
FRAMES, FRAME_NS = 4, 100_000_000
ASKED, WEAK, REACH_M, RIGHT_M = 0.3, 0.05, 0.4, 0.1
"""Visible shares from which somebody is asked for, and below which a skeleton is nobody's; largest mean
distance of a person's skeleton; largest error of a right joint, metres."""
SHOWN, DISTANCES_M, RETURNED = (0.3, 0.5, 0.8, 1.01), (0.0, 2.5, 4.0, 12.0), (0.0, 0.6, 0.9, 1.01)
"""Bounds of the groups by visible share, by distance, and by the share of it that returns depth."""
DARK = {"denim", "black cloth", "leather"}
"""Materials that return little."""

_TORSO = [JOINT_INDEX[f"{side}_{n}"] for side in ("left", "right") for n in ("shoulder", "hip")]


class Asked(NamedTuple):
    """A person who is asked for: what is seen of them, and how they are answered (NaN if not)."""

    sensor: str
    mounting: str
    shown: float
    returned: float
    distance: float
    dark: bool
    mm: float
    within: float
    overlap: float


class Home(NamedTuple):
    """Results of a home: people, skeletons of nobody, and tracks with their probability and truth."""

    sensor: str
    mounting: str
    people: list[Asked]
    false: int
    tracks: list[tuple[float, bool]]


def measure(pipeline: PosePipeline, k: int) -> Home:
    """Run the pipeline over home number ``k``."""
    rng = np.random.default_rng([SEED, k])
    home = furnished_home(rng, sensor=HOME_FAMILIES[k % len(HOME_FAMILIES)])
    steady = int(rng.integers(2**31))
    pipeline.reset()
    for t in range(FRAMES):
        scene = render(home.view, home.surfaces, home.persons, home.sensor, rng, steady)
        result = pipeline.process_frame(DepthFrame(1 + t * FRAME_NS, "", scene.depth, scene.camera))
    return score(scene, result, pipeline)


def score(scene: Scene, result: FrameResult, pipeline: PosePipeline) -> Home:
    """Match the last frame's skeletons with the people, the nearest first."""
    off = [np.linalg.norm(s.positions - scene.joints, axis=-1) for s in result.skeletons]
    distance = np.array([d.mean(axis=1) for d in off]).reshape(len(off), len(scene.joints))
    distance[:, scene.visible < WEAK] = np.inf
    owner: dict[int, int] = {}
    for flat in np.argsort(distance, axis=None):
        which, person = np.unravel_index(flat, distance.shape)
        if distance[which, person] <= REACH_M and which not in owner.values() and person not in owner:
            owner[int(person)] = int(which)
    mounting, people = mounting_of(scene), []
    for person in np.flatnonzero(scene.visible >= ASKED).tolist():
        fabrics = dict(zip(WORN, scene.fabrics[person], strict=True)) if scene.fabrics[person] else {}
        which = owner.get(person)
        errors = np.array([np.nan]) if which is None else off[which][person]
        people.append(
            Asked(
                scene.sensor,
                mounting,
                float(scene.visible[person]),
                float(scene.returned[person]),
                float(scene.joints[person, _TORSO, 2].mean()),
                bool(fabrics) and {fabrics["top"], fabrics["trousers"]} <= DARK,
                1000.0 * float(errors.mean()),
                float((errors < RIGHT_M).mean()),
                np.nan if which is None else overlap(scene, person, result, which),
            )
        )
    return Home(
        scene.sensor, mounting, people, len(off) - len(owner), list(believed(scene, result, pipeline))
    )


def overlap(scene: Scene, person: int, result: FrameResult, which: int) -> float:
    """Intersection over union of a skeleton's mask and its person's, of pixels with depth."""
    people, name = result.people, result.skeletons[which].body_id
    label = next(p.found.label for p in people.persons if p.body_id == name)
    ratio = scene.camera.fx / people.camera.fx
    height, width = people.labels.shape
    rows = ((np.arange(height) + 0.5) * ratio).astype(int).clip(0, scene.camera.height - 1)
    columns = ((np.arange(width) + 0.5) * ratio).astype(int).clip(0, scene.camera.width - 1)
    at = np.ix_(rows, columns)
    own = (people.labels == label) & (scene.depth[at] > 0)
    truth = (scene.person[at] == person + 1) & (scene.depth[at] > 0)
    return float((own & truth).sum() / max(1, (own | truth).sum()))


def believed(scene: Scene, result: FrameResult, pipeline: PosePipeline) -> Iterator[tuple[float, bool]]:
    """Yield each track's person probability and whether it is one, except those of whom little shows."""
    odds, torsos = PersonOdds.load(), scene.joints[:, _TORSO].mean(axis=1)
    for person in result.people.persons:
        pose_distance = pipeline.states[person.body_id].evidence.pose_distance
        if person.measured is None or pose_distance is None:
            continue
        away = np.linalg.norm(torsos - person.measured.places[_TORSO].mean(axis=0), axis=1)
        near = float(scene.visible[away < REACH_M].max(initial=0.0))
        if not WEAK < near < ASKED:
            yield odds.after_fit(person.found.probability, pose_distance), near >= ASKED


def mounting_of(scene: Scene) -> str:
    """Classify the camera's mounting by the first condition that holds."""
    right, down, ahead = scene.up.astype(float)
    pitch, roll = np.degrees(np.arcsin(np.clip(-ahead, -1, 1))), np.degrees(np.arctan2(right, -down))
    if pitch > 40:
        return "over 40 degrees down"
    if abs(roll) > 45:
        return "rolled by more than 45 degrees"
    return "below 0.7 m" if scene.height < 0.7 else "others"


def table(homes: list[Home]) -> str:
    """Tabulate people by sensor, mounting, visible share, distance, depth and clothes."""
    people = [p for h in homes for p in h.people]
    rows = [("all", people, homes)]
    for kind, names in (("sensor", HOME_FAMILIES), ("mounting", sorted({h.mounting for h in homes}))):
        rows += [
            (
                name,
                [p for p in people if getattr(p, kind) == name],
                [h for h in homes if getattr(h, kind) == name],
            )
            for name in names
        ]
    rows += [
        (f"{a:g} to {min(b, 1):g} shows", [p for p in people if a <= p.shown < b], [])
        for a, b in pairwise(SHOWN)
    ]
    rows += [
        (f"{a:g} to {b:g} m", [p for p in people if a <= p.distance < b], [])
        for a, b in pairwise(DISTANCES_M)
    ]
    rows += [
        (f"{a:g} to {min(b, 1):g} of it returns", [p for p in people if a <= p.returned < b], [])
        for a, b in pairwise(RETURNED)
    ]
    rows.append(("in dark clothes", [p for p in people if p.dark], []))
    lines = [
        "| people | asked | found | false a home | masks' overlap | mm | within 10 cm |",
        "|---" * 7 + "|",
    ]
    for name, some, places in rows:
        found = [p for p in some if np.isfinite(p.mm)]
        if not found:
            continue
        false = f"{np.mean([h.false for h in places]):.3f}" if places else ""
        lines.append(
            f"| {name} | {len(some)} | {len(found) / len(some):.3f} | {false} | "
            f"{np.median([p.overlap for p in found]):.2f} | {np.mean([p.mm for p in found]):.0f} | "
            f"{sum(p.within for p in found) / len(some):.3f} |"
        )
    return "\n".join(lines)


def calibration(homes: list[Home]) -> str:
    """Tabulate stated probabilities beside the share of people, by fifths, and their mean difference."""
    lines = ["| sensor | tracks | stated | people | mean gap by fifths |", "|---|---|---|---|---|"]
    for name in (*HOME_FAMILIES, "all"):
        of = [t for h in homes for t in h.tracks if name in (h.sensor, "all")]
        if len(of) < 5:
            continue
        p, right = np.array(of, float).T
        fifths = np.array_split(np.argsort(p), 5)
        gap = np.mean([abs(p[some].mean() - right[some].mean()) for some in fifths])
        lines.append(f"| {name} | {len(p)} | {p.mean():.3f} | {right.mean():.3f} | {gap:.3f} |")
    return "\n".join(lines)


def read(line: str) -> Home:
    """Read a home's results."""
    sensor, mounting, people, false, tracks = json.loads(line)
    return Home(sensor, mounting, [Asked(*p) for p in people], false, [(p, r) for p, r in tracks])


def main() -> None:
    """Measure and print."""
    parser = make_parser(__doc__)
    parser.add_argument("--homes", type=int, default=100, help="how many; one in five is empty")
    parser.add_argument("--results", type=Path, help="file of results by home; an interrupted run continues")
    arguments = parser.parse_args()
    kept = (
        arguments.results.read_text().splitlines() if arguments.results and arguments.results.exists() else []
    )
    homes = [read(line) for line in kept[: arguments.homes]]
    if len(homes) < arguments.homes:
        pipeline = PosePipeline(Bank.load(default_bank_path()))
        for k in track(range(len(homes), arguments.homes), "homes"):
            homes.append(measure(pipeline, k))
            if arguments.results:
                with arguments.results.open("a") as stream:
                    stream.write(json.dumps(homes[-1]) + "\n")
    print(table(homes), "\n")
    print(calibration(homes))
