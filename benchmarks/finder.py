"""Evaluate the released people finder, both looks, in simulated rooms that were not used in training.

    python benchmarks/finder.py                        # 500 rooms, about three minutes
    python benchmarks/finder.py --rooms 100 --weights build/people_finder/weights
    python benchmarks/finder.py --lookalikes           # rooms without people, but with coats
    python benchmarks/finder.py --mounting ceiling     # cameras of one mounting only
    python benchmarks/finder.py --sensor stereo        # the same rooms, sensors of one family
    python benchmarks/finder.py --homes --results a.jsonl    # homes; continues an interrupted run

Each room is one frame by itself: no tracks. A person is found if half of a detection's pixels are theirs
and its torso lies within 0.4 m of theirs; a detection that is nobody's is false, and counts for the kind of
thing that most of its pixels show. Prints tables in Markdown: who is found, false ones and how well masks
agree, by sensor and by mounting; recall by visible share, by distance, by the share of the person that has
depth, and by dark clothes; the objects behind false ones; calibration of the probability by sensor; time.
"""

from __future__ import annotations

import one_thread  # noqa: F401

# isort: split

import hashlib
import json
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from command_line import make_parser
from rich.progress import track

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.detect.finder import PeopleFinder, load_weights
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.net import read_weights
from depth_pose.detect.segmentation import Segmentation
from depth_pose.detect.tuning import DetectTuning
from depth_pose.sim.home_scenes import sample_home
from depth_pose.sim.home_sensors import HOME_FAMILIES
from depth_pose.sim.materials import WORN
from depth_pose.sim.scene_noise import FAMILIES
from depth_pose.sim.scenes import MOUNTINGS, Scene, sample_scene
from depth_pose.sim.shapes import Kind

SEED = 700_001
"""The training takes 1 and 2, the verifier 900,001 and 900,002."""

TORSO_M, OWN_SHARE = 0.4, 0.5
"""Somebody found is a person of the scene whose torso is nearer than the first, metres, and who has at least
the second as a share of their pixels. Set by hand."""
SHOWN = (0.1, 0.3, 0.6, 1.01)
"""Bounds of the groups by the visible share of a person."""
DISTANCES_M = (0.0, 1.2, 2.2, 3.5, 12.0)
"""Bounds of the groups by distance, metres."""
STEEP_DEG, ROLLED_DEG, LOW_M = (40, 65), 45, 0.7
"""Bounds of the groups by mounting."""
ASKED = 0.3
"""People whose visible share is below this do not count, as in the sequences with references."""

RETURNED = (0.0, 0.3, 0.6, 0.9, 1.01)
"""Bounds of the groups by the share of what is shown of a person that returns depth."""
DARK = {"denim", "black cloth", "leather"}
"""Materials that return little."""
BINS = np.array([0.2, 0.4, 0.6, 0.8, 0.9, 1.0])
"""Bounds of the probabilities that calibration is measured in."""

_TORSO = [JOINT_INDEX[n] for n in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")]


@dataclass
class Tally:
    """Results: one row per person, one row per detection."""

    people: list[tuple[float, float, int, float, float, float, bool]] = field(default_factory=list)
    """Visible share; distance; frame; probability of the detection, 0 for none; the masks' overlap; share of
    the shown that has depth; whether top and trousers are of materials that return little."""

    views: list[tuple[str, str]] = field(default_factory=list)
    """Sensor and mounting of each frame."""

    detections: list[tuple[float, bool, int]] = field(default_factory=list)
    """Probability; whether it is a person; frame."""

    false_kinds: list[tuple[float, Kind, int]] = field(default_factory=list)
    """Probability, kind of object and frame of each false detection."""

    milliseconds: list[float] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """Number of rooms evaluated."""
        return len(self.views)

    def append(self, other: Tally) -> None:
        """Append the results of another."""
        first = self.frames
        self.people += [(*p[:2], p[2] + first, *p[3:]) for p in other.people]
        self.detections += [(p, right, f + first) for p, right, f in other.detections]
        self.false_kinds += [(p, Kind(kind), f + first) for p, kind, f in other.false_kinds]
        self.views += [(sensor, mounting) for sensor, mounting in other.views]
        self.milliseconds += other.milliseconds


@dataclass(frozen=True)
class Rooms:
    """Unseen rooms by their number.

    Attributes
    ----------
    seed : int
    homes : bool
        Homes instead of rooms.
    lookalikes : bool
        Nobody in them.
    mounting, sensor : str, optional
        Of all; random by default.
    """

    seed: int
    homes: bool = False
    lookalikes: bool = False
    mounting: str | None = None
    sensor: str | None = None

    def make(self, k: int) -> Scene:
        """Make room number ``k``."""
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, k]))
        people = 0 if self.lookalikes else None
        if self.homes:
            return sample_home(rng, people=people, mounting=self.mounting, sensor=self.sensor)
        studio = False if self.lookalikes else None
        return sample_scene(
            rng,
            people=people,
            studio=studio,
            lookalikes=self.lookalikes,
            mounting=self.mounting,
            sensor=self.sensor,
        )


def mounting_of(scene: Scene) -> str:
    """Classify the camera's mounting by the first condition that holds."""
    right, down, ahead = scene.up.astype(float)
    pitch, roll = np.degrees(np.arcsin(np.clip(-ahead, -1, 1))), np.degrees(np.arctan2(right, -down))
    if pitch > STEEP_DEG[1]:
        return f"over {STEEP_DEG[1]} degrees down"
    if pitch > STEEP_DEG[0]:
        return f"{STEEP_DEG[0]} to {STEEP_DEG[1]} degrees down"
    if abs(roll) > ROLLED_DEG:
        return f"rolled by more than {ROLLED_DEG} degrees"
    return f"below {LOW_M} m" if scene.height < LOW_M else "others"


def frame_of(scene: Scene) -> DepthFrame:
    """Build the frame that the sensor measures."""
    return DepthFrame(0, "", scene.depth, scene.camera)


def on_grid(image: np.ndarray, found: Segmentation, scene: Scene) -> np.ndarray:
    """Resample an image of the scene on the finder's working grid."""
    ratio = scene.camera.fx / found.camera.fx
    rows = ((np.arange(found.labels.shape[0]) + 0.5) * ratio).astype(int).clip(0, image.shape[0] - 1)
    cols = ((np.arange(found.labels.shape[1]) + 0.5) * ratio).astype(int).clip(0, image.shape[1] - 1)
    return image[np.ix_(rows, cols)]


def score(tally: Tally, scene: Scene, found: Segmentation) -> None:
    """Match one frame's detections with the truth, the most probable first."""
    tally.views.append((scene.sensor, mounting_of(scene)))
    owner, kind = on_grid(scene.person, found, scene), on_grid(scene.kind, found, scene)
    torsos = scene.joints[:, _TORSO].mean(axis=1)
    best, overlaps = np.zeros(len(torsos)), np.full(len(torsos), np.nan)
    measured = on_grid(scene.depth, found, scene) > 0
    for person in sorted(found.detections, key=lambda p: -p.probability):
        own = (found.labels == person.label) & measured
        shares = np.bincount(owner[own], minlength=len(torsos) + 1)[1:] / max(1, own.sum())
        near = np.linalg.norm(torsos - person.place, axis=1) < TORSO_M
        theirs = np.flatnonzero((shares >= OWN_SHARE) & near & (best == 0))
        right = bool(len(theirs)) or bool((shares >= OWN_SHARE).any())
        tally.detections.append((person.probability, right, tally.frames - 1))
        if len(theirs):
            k = theirs[0]
            best[k] = person.probability
            truth = (owner == k + 1) & measured
            overlaps[k] = (own & truth).sum() / max(1, (own | truth).sum())
        elif not (shares >= OWN_SHARE).any():
            things = np.bincount(kind[own], minlength=len(Kind))
            tally.false_kinds.append((person.probability, Kind(int(things.argmax())), tally.frames - 1))
    for k, torso in enumerate(torsos):
        fabrics = dict(zip(WORN, scene.fabrics[k], strict=True)) if scene.fabrics[k] else {}
        dark = bool(fabrics) and {fabrics["top"], fabrics["trousers"]} <= DARK
        shown, returned = float(scene.visible[k]), float(scene.returned[k])
        at, overlap = float(torso[2]), float(overlaps[k])
        tally.people.append((shown, at, tally.frames - 1, float(best[k]), overlap, returned, dark))


def kept_results(results: Path, about: dict[str, object]) -> list[Tally]:
    """Read the results of an earlier run, whose weights and rooms must be the same, or begin the file."""
    if not results.exists():
        results.write_text(json.dumps(about) + "\n")
    first, *lines = results.read_text().splitlines()
    if json.loads(first) != about:
        raise SystemExit(f"{results} holds results of {first}; choose another file")
    return [Tally(**json.loads(line)) for line in lines]


def measure(
    config: SegmentConfig, weights: Path | None, rooms: Rooms, count: int, results: Path | None = None
) -> Tally:
    """Run finder and joint net over rooms; the finder is timed separately.

    With a file for ``results`` each room's are appended to it, and those in it are not made again.
    """
    total, finder = Tally(), PeopleFinder(config, *load_weights(weights))
    segmenter = LearnedSegmenter(config, weights)
    finder.warm_up()
    segmenter.warm_up()
    about = {"weights": hashes(weights), **asdict(rooms)}
    kept = [] if results is None else kept_results(results, about)
    for k in track(range(count), "homes" if rooms.homes else "rooms"):
        if k < len(kept):
            tally = kept[k]
        else:
            scene, tally = rooms.make(k), Tally()
            frame = frame_of(scene)
            start = time.thread_time()
            finder.find(frame)
            tally.milliseconds.append(1e3 * (time.thread_time() - start))
            segmenter.reset()
            score(tally, scene, segmenter.segment(frame))
            if results is not None:
                with results.open("a") as stream:
                    stream.write(json.dumps(asdict(tally)) + "\n")
        total.append(tally)
    return total


def hashes(weights: Path | None) -> list[str]:
    """Return short hashes of both nets' weights."""
    names = ("people_finder.onnx", "joint_finder.onnx")
    return [hashlib.sha256(read_weights(n, weights)).hexdigest()[:12] for n in names]


def table(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Format a table in Markdown."""
    columns = list(columns)
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(str(c) for c in line) + " |" for line in lines)


def by_group(tally: Tally, threshold: float) -> str:
    """Tabulate recall by group."""
    shown, distance, _, probability, _, returned, dark = (
        np.array(c) for c in zip(*tally.people, strict=True)
    )
    asked, hit = shown >= ASKED, probability >= threshold
    groups = [("all asked for", asked)]
    groups += [(f"{a:g} to {min(b, 1):g} shows", (shown >= a) & (shown < b)) for a, b in pairwise(SHOWN)]
    groups += [
        (f"{a:g} to {b:g} m", asked & (distance >= a) & (distance < b)) for a, b in pairwise(DISTANCES_M)
    ]
    groups += [
        (f"{a:g} to {min(b, 1):g} of it returns", asked & (returned >= a) & (returned < b))
        for a, b in pairwise(RETURNED)
    ]
    groups.append(("in dark clothes", asked & dark))
    rows = ((name, int(g.sum()), f"{hit[g].mean():.3f}") for name, g in groups if g.any())
    return table(("people", "number", f"found at {threshold:g}"), rows)


def by_view(tally: Tally, threshold: float) -> str:
    """Tabulate recall, false detections and mask overlap by sensor and by mounting."""
    shown, _, frame, probability, overlap, *_ = (np.array(c) for c in zip(*tally.people, strict=True))
    false = np.array([f for p, _, f in tally.false_kinds if p >= threshold], int)
    views = np.array(tally.views)
    rows = []
    for column in (0, 1):
        for name in np.unique(views[:, column]):
            here = views[:, column] == name
            asked = here[frame.astype(int)] & (shown >= ASKED)
            found = asked & (probability >= threshold)
            rows.append(
                (
                    name,
                    int(here.sum()),
                    int(asked.sum()),
                    f"{found.sum() / max(1, asked.sum()):.3f}",
                    f"{here[false].sum() / here.sum():.3f}",
                    f"{np.nanmedian(overlap[found]):.2f}" if found.any() else "",
                )
            )
    columns = ("view", "rooms", "people", f"found at {threshold:g}", "false a room", "masks' overlap, median")
    return table(columns, rows)


def by_thing(tally: Tally, thresholds: tuple[float, ...]) -> str:
    """Tabulate the objects behind false detections."""
    counts = [Counter(kind.name.lower() for p, kind, _ in tally.false_kinds if p >= t) for t in thresholds]
    names = sorted(counts[0], key=lambda n: -counts[0][n])
    rows = [(n, *(c[n] for c in counts)) for n in names]
    rows.append(("all, a frame", *(f"{sum(c.values()) / tally.frames:.3f}" for c in counts)))
    return table(("false ones on", *(f"at {t:g}" for t in thresholds)), rows)


def reliability(tally: Tally) -> str:
    """Tabulate how often a detection of each probability is a person, and the calibration error by sensor."""
    p, right, frame = (np.array(c, float) for c in zip(*tally.detections, strict=True))
    sensors = np.array([tally.views[int(f)][0] for f in frame])
    bins = np.digitize(p, BINS[1:-1])
    used = [k for k in range(len(BINS) - 1) if (bins == k).any()]
    rows = [
        (
            f"{BINS[k]:g} to {BINS[k + 1]:g}",
            int((bins == k).sum()),
            f"{p[bins == k].mean():.2f}",
            f"{right[bins == k].mean():.2f}",
        )
        for k in used
    ]
    gaps = ", ".join(
        f"{name} {calibration_error(p[sensors == name], right[sensors == name]):.3f}"
        for name in np.unique(sensors)
    )
    columns = ("probability", "detections", "mean", "are people")
    return table(columns, rows) + f"\n\nCalibration error {calibration_error(p, right):.3f}: {gaps}."


def calibration_error(probability: np.ndarray, right: np.ndarray) -> float:
    """Return the mean distance of the probabilities from the share of people, over `BINS`."""
    bins = np.digitize(probability, BINS[1:-1])
    groups = [bins == k for k in np.unique(bins)]
    return float(sum(g.mean() * abs(probability[g].mean() - right[g].mean()) for g in groups))


def main() -> None:
    """Measure and print."""
    parser = make_parser(__doc__)
    parser.add_argument("--rooms", type=int, default=500, help="how many rooms")
    parser.add_argument("--seed", type=int, default=SEED, help="of the rooms")
    parser.add_argument("--weights", type=Path, help="folder of other weights than the released ones")
    parser.add_argument("--lookalikes", action="store_true", help="rooms without people, but with coats")
    parser.add_argument("--homes", action="store_true", help="homes: dark clothes, pets, clutter")
    parser.add_argument("--results", type=Path, help="file of results by room; an interrupted run continues")
    parser.add_argument(
        "--mounting", choices=[*MOUNTINGS, "robot", "shelf"], help="mounting of cameras; random by default"
    )
    parser.add_argument(
        "--sensor",
        choices=list(dict.fromkeys((*FAMILIES, *HOME_FAMILIES))),
        help="sensor family in all rooms; random by default",
    )
    arguments = parser.parse_args()
    config = SegmentConfig()
    shown = Rooms(arguments.seed, arguments.homes, arguments.lookalikes, arguments.mounting, arguments.sensor)
    tally = measure(config, arguments.weights, shown, arguments.rooms, arguments.results)
    first, second = hashes(arguments.weights)
    print(f"Weights {first} and {second}, {tally.frames} rooms of seed {arguments.seed}\n")
    thresholds = (DetectTuning().keep, config.start, 0.8)
    print(by_thing(tally, thresholds), "\n")
    if tally.people:
        print(by_view(tally, config.start), "\n")
        print(by_group(tally, config.start), "\n")
        print(reliability(tally), "\n")
        low, median, high = np.nanpercentile([p[4] for p in tally.people], (10, 50, 90))
        print(f"Overlap with the truth: median {median:.2f} ({low:.2f} to {high:.2f}). ", end="")
    print(f"Processor time {np.median(tally.milliseconds):.1f} ms a frame (320 wide), median, first look.")


if __name__ == "__main__":
    main()
