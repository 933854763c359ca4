"""Score the people finder by itself on recordings with a reference.

    python tools/people_finder/score_clips.py DATA --weights runs/a/finder.onnx

DATA is a folder of folders of recordings: NAME.mcap with NAME.json (boxes of people, real sequences),
NAME.npz (joints) or with neither (``real_empty``: nobody).
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.detect.finder import FinderResult, PeopleFinder, TorsoDetection, load_weights
from depth_pose.detect.tuning import DetectTuning
from depth_pose.io.mcap_read import read_frames

_SEQUENCES = ("real_office", "real_corridor", "real_empty", "dev_people", "dev_postures", "dev", "dev_bodies")
_SINGLES = ("real_kinect2", "real_itop", "real_wave")
_DEPTH_M, _TORSO_M = 0.5, 0.4
"""Largest distance from the matching reference, metres: of the median depth and the torso. Set by hand."""
_ASKED, _WEAK = 0.3, 0.05
"""People visible by less than the first share do not count, by less than the second: absent. Set by hand."""

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Seen:
    """A detected person's pixels in the frame, and their medians."""

    probability: float
    column: float
    row: float
    depth: float
    columns: NDArray[np.float64]
    rows: NDArray[np.float64]
    torso: NDArray[np.float64]


def look(found: FinderResult, person: TorsoDetection, frame: DepthFrame) -> Seen | None:
    """Convert a person's pixels to those of the frame; None if there are none."""
    rows, cols = np.nonzero(found.labels == person.label)
    if len(rows) == 0:
        return None
    ratio = frame.camera.fx / found.camera.fx
    z = found.depth[rows, cols]
    rows, cols = (rows + 0.5) * ratio - 0.5, (cols + 0.5) * ratio - 0.5
    return Seen(
        person.probability,
        float(np.median(cols)),
        float(np.median(rows)),
        float(np.median(z)),
        cols,
        rows,
        person.torso,
    )


def fits_box(seen: Seen, box: list[float], depth: float) -> bool:
    """Whether the median and half of the pixels lie in a reference's box, at its distance."""
    x0, y0, x1, y1 = box
    grow_x, grow_y = 0.1 * (x1 - x0), 0.1 * (y1 - y0)
    inside = (
        (seen.columns >= x0 - grow_x)
        & (seen.columns <= x1 + grow_x)
        & (seen.rows >= y0 - grow_y)
        & (seen.rows <= y1 + grow_y)
    )
    middle = x0 - grow_x <= seen.column <= x1 + grow_x and y0 - grow_y <= seen.row <= y1 + grow_y
    return bool(middle and inside.mean() >= 0.5 and (depth <= 0 or abs(seen.depth - depth) < _DEPTH_M))


def score_boxes(seen: list[Seen], reference: dict) -> Counter:
    """Count people found, false and double in a real sequence."""
    count = Counter(frames=1, found_all=len(seen))
    persons = reference["persons"]
    asked = [p for p in persons if not p["ignore"]]
    taken: set[int] = set()
    for p in asked:
        count["asked"] += 1
        fitting = [
            k for k, s in enumerate(seen) if k not in taken and fits_box(s, p["box"], p["median_depth_m"])
        ]
        if fitting:
            taken.add(max(fitting, key=lambda k: len(seen[k].rows)))
            count["found"] += 1
    for k, s in enumerate(seen):
        if k in taken:
            continue
        matches = [p for p in persons if fits_box(s, p["box"], 0.0)]
        if not matches:
            count["false"] += 1
        elif all(not p["ignore"] for p in matches):
            count["double"] += 1
    if not persons:
        count["empty"] += 1
        count["empty_hit"] += bool(seen)
    return count


def score_joints(seen: list[Seen], joints: NDArray[np.float64], visible: NDArray[np.float64]) -> Counter:
    """Count detections whose torso is within 0.4 m of the truth, and false ones."""
    count = Counter(frames=1, found_all=len(seen))
    torso = joints[:, _TORSO_JOINTS].mean(axis=1)
    asked = [k for k in range(len(joints)) if visible[k] >= _ASKED]
    taken: set[int] = set()
    for k in asked:
        count["asked"] += 1
        near = [(float(np.linalg.norm(s.torso - torso[k])), n) for n, s in enumerate(seen) if n not in taken]
        if near and min(near)[0] < _TORSO_M:
            n = min(near)[1]
            taken.add(n)
            count["found"] += 1
            count["torso_mm"] += 1000 * min(near)[0]
    for n, s in enumerate(seen):
        if n in taken:
            continue
        known = [
            k
            for k in range(len(joints))
            if visible[k] >= _WEAK and np.linalg.norm(s.torso - torso[k]) < _TORSO_M
        ]
        if not known:
            count["false"] += 1
        elif all(visible[k] >= _ASKED for k in known):
            count["double"] += 1
    return count


_TORSO_JOINTS = [5, 8, 11, 15]
"""Shoulders and hips."""


def score_recording(
    path: Path, finder: PeopleFinder, step: int, thresholds: list[float]
) -> dict[float, Counter]:
    """Score one recording at several thresholds."""
    boxes = path.with_suffix(".json")
    truth = path.with_suffix(".npz")
    by_stamp = {}
    if boxes.exists() and path.parent.name in ("real_office", "real_corridor"):
        by_stamp = {r["stamp_ns"]: r for r in json.loads(boxes.read_text())}
    counts = {t: Counter() for t in thresholds}
    data = np.load(truth) if truth.exists() and path.parent.name != "real_wave" else None
    for n, frame in enumerate(read_frames(path)):
        reference = by_stamp.get(frame.stamp_ns)
        if n % step or (by_stamp and reference is None):
            continue
        found = finder.find(frame)
        every = [s for s in (look(found, p, frame) for p in found.people) if s is not None]
        for t in thresholds:
            seen = [s for s in every if s.probability >= t]
            if reference is not None:
                counts[t] += score_boxes(seen, reference)
            elif data is not None:
                k = int(np.argmin(np.abs(data["stamps_ns"] - frame.stamp_ns)))
                joints = data["joints"][k].astype(float)
                joints = joints[None] if joints.ndim == 2 else joints
                visible = data["visible"][k] if "visible" in data else np.ones(len(joints))
                counts[t] += score_joints(seen, joints, visible)
            else:
                one = path.parent.name in _SINGLES
                counts[t] += Counter(
                    frames=1,
                    asked=int(one),
                    found=int(one and len(seen) > 0),
                    false=max(0, len(seen) - int(one)),
                    empty=int(not one),
                    empty_hit=int(not one and len(seen) > 0),
                )
    return counts


def line(name: str, c: Counter) -> str:
    """Format one line of figures."""
    n = max(c["found"], 1)
    return (
        f"{name:14s} frames {c['frames']:4d} asked {c['asked']:4d} "
        f"recall {c['found'] / max(c['asked'], 1):.3f} "
        f"false {c['false']:3d} = {c['false'] / max(c['frames'], 1):.3f} double {c['double']:3d} "
        f"empty {c['empty_hit']}/{c['empty']} torso {c['torso_mm'] / n:.0f} mm"
    )


@app.command()
def main(
    data: Annotated[Path, typer.Argument(help="Folder of folders of recordings")],
    weights: Annotated[Path | None, typer.Option(help="Net to score (.onnx, its .json beside it)")] = None,
    only: Annotated[list[str] | None, typer.Option(help="Folders to score")] = None,
    step: Annotated[int, typer.Option(help="Score every n-th frame of clips with joints")] = 10,
    threshold: Annotated[list[float] | None, typer.Option(help="Detection thresholds (probability)")] = None,
    each: Annotated[bool, typer.Option(help="Print a line for every recording")] = False,
) -> None:
    """Score the finder."""
    thresholds = threshold or [0.3, 0.5, 0.6, 0.8]
    if weights is None:
        finder = PeopleFinder(SegmentConfig(), *load_weights(), DetectTuning(keep=min(thresholds)))
    else:
        settings = json.loads(weights.with_suffix(".json").read_text())
        finder = PeopleFinder(
            SegmentConfig(), weights.read_bytes(), settings, DetectTuning(keep=min(thresholds))
        )
    for name in only or [*_SEQUENCES, *_SINGLES]:
        total = {t: Counter() for t in thresholds}
        for path in sorted((data / name).glob("*.mcap")):
            dense = name.startswith("real") or name == "dev_people"
            counts = score_recording(
                path, finder, max(1, step // 4) if name == "dev_people" else 1 if dense else step, thresholds
            )
            for t in thresholds:
                total[t] += counts[t]
                if each:
                    print(line(f"{path.stem} {t}", counts[t]))
        for t in thresholds:
            print(line(f"{name} {t}", total[t]), flush=True)


if __name__ == "__main__":
    app()
