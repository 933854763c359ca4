"""Evaluate the released people finder, both looks, in simulated rooms that were not used in training.

    python benchmarks/finder.py                        # 500 rooms, about three minutes
    python benchmarks/finder.py --rooms 100 --weights build/people_finder/weights
    python benchmarks/finder.py --lookalikes           # rooms without people, but with coats
    python benchmarks/finder.py --mounting ceiling     # cameras of one mounting only
    python benchmarks/finder.py --sensor stereo        # the same rooms, sensors of one family

Each room is one frame by itself: no tracks. A person is found if half of a detection's pixels are theirs
and its torso lies within 0.4 m of theirs; a detection that is nobody's is false, and counts for the kind of
thing that most of its pixels show. Prints tables in Markdown: who is found, false ones and how well masks
agree, by sensor and by mounting; recall by visible share and by distance; the objects behind false ones;
calibration of the probability; time.
"""

from __future__ import annotations

import one_thread  # noqa: F401

# isort: split

import hashlib
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from command_line import make_parser
from rich.progress import track

from depth_pose.core.config import SegmentConfig
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.core.types import DepthFrame
from depth_pose.detect.finder import PeopleFinder, load_weights
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.net import read_weights
from depth_pose.detect.segmentation import Segmentation
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

_TORSO = [JOINT_INDEX[n] for n in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")]


@dataclass
class Tally:
    """Results: one row per person, one row per detection."""

    people: list[tuple[float, float, int, float, float]] = field(default_factory=list)
    """Visible share; distance; frame; probability of the detection, 0 for none; the masks' overlap."""

    views: list[tuple[str, str]] = field(default_factory=list)
    """Sensor and mounting of each frame."""

    detections: list[tuple[float, bool]] = field(default_factory=list)
    """Probability; whether it is a person."""

    false_kinds: list[tuple[float, Kind, int]] = field(default_factory=list)
    """Probability; what it is; frame."""

    milliseconds: list[float] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """Number of rooms evaluated."""
        return len(self.views)


def rooms(
    seed: int, count: int, lookalikes: bool = False, mounting: str | None = None, sensor: str | None = None
) -> Iterator[Scene]:
    """Make rooms one after another; those with ``lookalikes`` show nobody."""
    for k in range(count):
        rng = np.random.default_rng(np.random.SeedSequence([seed, k]))
        if lookalikes:
            yield sample_scene(rng, people=0, studio=False, lookalikes=True, mounting=mounting, sensor=sensor)
        else:
            yield sample_scene(rng, mounting=mounting, sensor=sensor)


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
        tally.detections.append((person.probability, bool(len(theirs)) or bool((shares >= OWN_SHARE).any())))
        if len(theirs):
            k = theirs[0]
            best[k] = person.probability
            truth = (owner == k + 1) & measured
            overlaps[k] = (own & truth).sum() / max(1, (own | truth).sum())
        elif not (shares >= OWN_SHARE).any():
            things = np.bincount(kind[own], minlength=len(Kind))
            tally.false_kinds.append((person.probability, Kind(int(things.argmax())), tally.frames - 1))
    for k, torso in enumerate(torsos):
        row = (float(scene.visible[k]), float(torso[2]), tally.frames - 1, best[k], overlaps[k])
        tally.people.append(row)


def measure(config: SegmentConfig, weights: Path | None, scenes: Iterable[Scene]) -> Tally:
    """Run both looks over scenes; the first one is timed by itself."""
    tally, finder = Tally(), PeopleFinder(config, *load_weights(weights))
    segmenter = LearnedSegmenter(config, weights)
    finder.warm_up()
    segmenter.warm_up()
    for scene in scenes:
        frame = frame_of(scene)
        start = time.thread_time()
        finder.find(frame)
        tally.milliseconds.append(1e3 * (time.thread_time() - start))
        segmenter.reset()
        score(tally, scene, segmenter.segment(frame))
    return tally


def table(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Format a table in Markdown."""
    columns = list(columns)
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(str(c) for c in line) + " |" for line in lines)


def by_group(tally: Tally, threshold: float) -> str:
    """Tabulate recall by group."""
    shown, distance, _, probability, _ = (np.array(c) for c in zip(*tally.people, strict=True))
    asked, hit = shown >= ASKED, probability >= threshold
    groups = [("all asked for", asked)]
    groups += [(f"{a:g} to {min(b, 1):g} shows", (shown >= a) & (shown < b)) for a, b in pairwise(SHOWN)]
    groups += [
        (f"{a:g} to {b:g} m", asked & (distance >= a) & (distance < b)) for a, b in pairwise(DISTANCES_M)
    ]
    rows = ((name, int(g.sum()), f"{hit[g].mean():.3f}") for name, g in groups if g.any())
    return table(("people", "number", f"found at {threshold:g}"), rows)


def by_view(tally: Tally, threshold: float) -> str:
    """Tabulate recall, false detections and mask overlap by sensor and by mounting."""
    shown, _, frame, probability, overlap = (np.array(c) for c in zip(*tally.people, strict=True))
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
    """Tabulate how often a detection of each probability is a person."""
    p, right = (np.array(c, float) for c in zip(*tally.detections, strict=True))
    edges = np.array([0.2, 0.4, 0.6, 0.8, 0.9, 1.0])
    bins = np.digitize(p, edges[1:-1])
    used = [k for k in range(len(edges) - 1) if (bins == k).any()]
    rows = [
        (
            f"{edges[k]:g} to {edges[k + 1]:g}",
            int((bins == k).sum()),
            f"{p[bins == k].mean():.2f}",
            f"{right[bins == k].mean():.2f}",
        )
        for k in used
    ]
    gap = sum((bins == k).mean() * abs(p[bins == k].mean() - right[bins == k].mean()) for k in used)
    return (
        table(("probability", "detections", "mean", "are people"), rows) + f"\n\nCalibration error {gap:.3f}."
    )


def main() -> None:
    """Measure and print."""
    parser = make_parser(__doc__)
    parser.add_argument("--rooms", type=int, default=500, help="how many rooms")
    parser.add_argument("--seed", type=int, default=SEED, help="of the rooms")
    parser.add_argument("--weights", type=Path, help="folder of other weights than the released ones")
    parser.add_argument("--lookalikes", action="store_true", help="rooms without people, but with coats")
    parser.add_argument("--mounting", choices=MOUNTINGS, help="mounting of cameras; random by default")
    parser.add_argument("--sensor", choices=FAMILIES, help="sensor family in all rooms; random by default")
    arguments = parser.parse_args()
    config = SegmentConfig()
    made = rooms(arguments.seed, arguments.rooms, arguments.lookalikes, arguments.mounting, arguments.sensor)
    tally = measure(config, arguments.weights, track(made, "rooms", total=arguments.rooms))
    names = ("people_finder.onnx", "joint_finder.onnx")
    first, second = (hashlib.sha256(read_weights(n, arguments.weights)).hexdigest()[:12] for n in names)
    print(f"Weights {first} and {second}, {tally.frames} rooms of seed {arguments.seed}\n")
    thresholds = (config.keep, config.start, 0.8)
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
