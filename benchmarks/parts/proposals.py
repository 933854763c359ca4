"""Compare skeletons with the second look's proposals: is the fit worth its time, on real recordings too?

    python benchmarks/accuracy.py proposals DATA [DATA ...]

Uses every NAME.mcap of a folder that has one of these beside it:

- NAME.npz, a truth file (`depth-pose eval`): mean distance of the joints, and share within 10 cm;
- NAME.json, a list of ``{"stamp_ns": ..., "persons": [{"box": [x0, y0, x1, y1], "median_depth_m": ...,
  "joints": {NAME: [u, v, score]}}]}`` in pixels of the depth image: shares of the joints within .10 and .05
  of the person's height in the image. A person with ``"ignore": true`` is left out.

Only joints of people with a skeleton count.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.evaluate.overlay import project
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline

Pair = tuple[np.ndarray, np.ndarray]
"""A person's answered and proposed joints, (19, 3) each."""

STANDING_M = 1.7
"""A person is taken to be this tall where the box shows less than `WHOLE` of it."""
WHOLE = 0.8
FAR = 0.35
"""An answer farther than this from a person, on average, is not theirs, in body heights."""


def answered(pipeline: PosePipeline, path: Path) -> Iterator[tuple[int, Camera, list[Pair]]]:
    """Yield stamp, camera, and every person with a skeleton."""
    pipeline.restart()
    for frame in DepthReader(path):
        result = pipeline.process_frame(frame)
        proposed = {p.body_id: p.found.proposals.astype(float) for p in result.people.persons}
        pairs = [(s.positions, proposed[s.body_id]) for s in result.skeletons if len(proposed[s.body_id])]
        yield frame.stamp_ns, frame.camera, pairs


def against_truth(pipeline: PosePipeline, path: Path) -> np.ndarray:
    """Distances (metres) of answers and proposals, (2, joints)."""
    truth = load_truth(path.with_suffix(".npz"))
    known = truth.joints if truth.joints.ndim == 4 else truth.joints[:, None]
    off = []
    for stamp_ns, _, pairs in answered(pipeline, path):
        for joints in known[int(np.argmin(np.abs(truth.stamps_ns - stamp_ns)))] if pairs else ():
            each = [[np.linalg.norm(one - joints, axis=1) for one in pair] for pair in pairs]
            off.append(min(each, key=lambda pair: float(pair[0].mean())))
    return np.concatenate(np.array(off), axis=1)


def against_image(pipeline: PosePipeline, path: Path) -> np.ndarray:
    """Distances (heights of the person) of answers and proposals in the image, (2, joints)."""
    known = {f["stamp_ns"]: f["persons"] for f in json.loads(path.with_suffix(".json").read_text())}
    stamps, off = np.array(sorted(known)), []
    for stamp_ns, camera, pairs in answered(pipeline, path):
        near = int(stamps[np.argmin(np.abs(stamps - stamp_ns))])
        for person in known[near] if pairs and abs(near - stamp_ns) < 2_000_000 else ():
            if person.get("ignore") or not person["joints"]:
                continue
            rows = [JOINT_INDEX[name] for name in person["joints"]]
            places = np.array([uv[:2] for uv in person["joints"].values()])
            height = height_px(person, camera)
            each = [
                [np.linalg.norm(project(one, camera)[rows] - places, axis=1) / height for one in pair]
                for pair in pairs
            ]
            best = min(each, key=lambda pair: float(pair[0].mean()))
            if best[0].mean() < FAR:
                off.append(np.array(best))
    return np.concatenate(off, axis=1)


def height_px(person: dict, camera: Camera) -> float:
    """Height of a person in the image, pixels; that of a standing adult if they are cut off or seated."""
    _, top, _, bottom = person["box"]
    depth = person.get("median_depth_m", 0.0)
    standing = STANDING_M * camera.fy / depth if depth > 0 else 0.0
    return float(bottom - top) if bottom - top >= WHOLE * standing else standing


def main() -> None:
    """Run and report."""
    parser = make_parser(__doc__)
    parser.add_argument("data", type=Path, nargs="+", help="folders of recordings")
    parser.add_argument("--bank", type=Path, default=default_bank_path())
    arguments = parser.parse_args()
    pipeline = PosePipeline(Bank.load(arguments.bank))
    print("| data | joints | answers | proposals |\n|---|---|---|---|")
    for folder in arguments.data:
        for ending, measure in ((".npz", against_truth), (".json", against_image)):
            paths = [p for p in sorted(folder.glob("*.mcap")) if p.with_suffix(ending).exists()]
            if paths:
                off = np.concatenate([measure(pipeline, path) for path in paths], axis=1)
                cells = [in_words(one, ending) for one in off]
                print(f"| {folder.name} | {off.shape[1]} | {cells[0]} | {cells[1]} |", flush=True)
    if not any(folder.glob("*.mcap") for folder in arguments.data):
        raise InputError("the folders have no recordings")


def in_words(off: np.ndarray, ending: str) -> str:
    """Summarise distances as text."""
    if ending == ".npz":
        return f"{1000 * off.mean():.1f} mm, {(off < 0.1).mean():.3f}"
    return f"{(off < 0.10).mean():.3f} / {(off < 0.05).mean():.3f}"


if __name__ == "__main__":
    main()
