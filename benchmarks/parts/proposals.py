"""Compare skeletons with the joint net's proposals: is the fit worth its time, on real recordings too?

    python benchmarks/accuracy.py proposals DATA [DATA ...]

Uses every NAME.mcap of a folder that has one of these beside it:

- NAME.npz, a truth file (`depth-pose eval`): mean distance of the joints, and share within 10 cm; also the
  shares of proposals within the deviation that they state, in the image plane and in depth, of which the
  net's distributions claim .70 and .76;
- NAME.npz of another tracker, which has fewer joints and places them otherwise: shares within .10 and .05 of
  a standing height, each joint's mean offset in the torso's axes removed;
- NAME.json, a list of ``{"stamp_ns": ..., "persons": [{"box": [x0, y0, x1, y1], "median_depth_m": ...,
  "joints": {NAME: [u, v, score]}}]}`` in pixels of the depth image: shares of the joints within .10 and .05
  of the person's height in the image. A person with ``"ignore": true`` is left out. References from a colour
  image that is not registered with the depth image are all shifted alike: the shares are also given without
  the folder's median offset;
- joints_2d.json, a list of one ``{NAME: [u, v, score]}`` for each frame of people who are cut out: the same
  shares; the height is that of all that the frame shows.

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
from depth_pose.core.frame import DepthFrame
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS
from depth_pose.evaluate.overlay import project
from depth_pose.evaluate.score import torso_axes
from depth_pose.evaluate.truth import load_known_people
from depth_pose.io.mcap_read import DepthReader
from depth_pose.pipeline import PosePipeline

Person = tuple[np.ndarray, np.ndarray, np.ndarray]
"""A person's answered and proposed joints, (19, 3) each, and the deviations of these, (19, 2)."""

STANDING_M = 1.7
"""A person is taken to be this tall where the box shows less than `WHOLE` of it."""
WHOLE = 0.8
CUT_OUT = "joints_2d.json"
"""References of frames that show one person and nothing else."""
FAR = 0.35
"""An answer farther than this from a person, on average, is not theirs, in body heights."""


def answered(pipeline: PosePipeline, path: Path) -> Iterator[tuple[DepthFrame, list[Person]]]:
    """Yield each frame, and every person with a skeleton."""
    pipeline.restart()
    for frame in DepthReader(path):
        result = pipeline.process_frame(frame)
        found = {p.body_id: p.found for p in result.people.persons}
        pairs = [(s, found[s.body_id]) for s in result.skeletons if found[s.body_id].measured]
        people = [(s.positions, f.measured.places.astype(float), f.measured.sigma) for s, f in pairs]
        yield frame, people


def against_truth(pipeline: PosePipeline, path: Path) -> np.ndarray:
    """Errors (metres) of answers and proposals, and those of proposals in deviations, (joints, 4)."""
    truth, off = load_known_people(path.with_suffix(".npz")), []
    for frame, people in answered(pipeline, path):
        nearest = int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))
        for joints in truth.joints[nearest] if people else ():
            away = [float(np.linalg.norm(p[0] - joints, axis=1).mean()) for p in people]
            if not min(away) < FAR * STANDING_M:  # nor where the truth knows no such person
                continue
            answer, proposed, sigma = people[int(np.argmin(away))]
            ray = proposed / np.linalg.norm(proposed, axis=1, keepdims=True)
            deep = ((proposed - joints) * ray).sum(axis=1, keepdims=True)
            across = np.linalg.norm(proposed - joints - deep * ray, axis=1) / (np.sqrt(2.0) * sigma[:, 0])
            both = [np.linalg.norm(one - joints, axis=1) for one in (answer, proposed)]
            off.append(np.column_stack([*both, across, np.abs(deep[:, 0]) / sigma[:, 1]]))
    return np.concatenate(off) if off else np.zeros((0, 4))


def against_tracker(pipeline: PosePipeline, path: Path) -> np.ndarray:
    """Offsets (heights) of answers and proposals from another tracker's joints, (joints, 2, 3)."""
    known, off = load_known_people(path.with_suffix(".npz")), []
    rows = [JOINT_INDEX[name] for name in known.names]
    for frame, people in answered(pipeline, path):
        joints = known.joints[int(np.argmin(np.abs(known.stamps_ns - frame.stamp_ns))), 0]
        if people:
            both = np.stack([one[rows] for one in people[0][:2]], axis=1) - joints[:, None]
            off.append(both @ torso_axes(joints, known.names) / STANDING_M)
    return np.concatenate(off - np.mean(off, axis=0))


def against_image(pipeline: PosePipeline, path: Path) -> np.ndarray:
    """Offsets (heights of the person) of answers and proposals in the image, (joints, 2, 2)."""
    known = {f["stamp_ns"]: f["persons"] for f in json.loads(path.with_suffix(".json").read_text())}
    stamps, off = np.array(sorted(known)), []
    for frame, people in answered(pipeline, path):
        near = int(stamps[np.argmin(np.abs(stamps - frame.stamp_ns))])
        for person in known[near] if people and abs(near - frame.stamp_ns) < 2_000_000 else ():
            if person.get("ignore") or not person["joints"]:
                continue
            off += nearest_offsets(people, person["joints"], height_px(person, frame.camera), frame.camera)
    return np.concatenate(off)


def against_cut_out(pipeline: PosePipeline, path: Path) -> np.ndarray:
    """Return the same for frames that show one person and nothing else."""
    known, off = json.loads(path.with_name(CUT_OUT).read_text()), []
    for (frame, people), joints in zip(answered(pipeline, path), known, strict=True):
        height = float(np.ptp(np.flatnonzero((frame.depth > 0).any(axis=1)))) + 1.0
        off += nearest_offsets(people, joints, height, frame.camera) if people else []
    return np.concatenate(off)


def nearest_offsets(
    people: list[Person], joints: dict[str, list[float]], height: float, camera: Camera
) -> list[np.ndarray]:
    """Return the offsets (joints, 2, 2) of the nearest skeleton, in heights; nothing where it is far off."""
    rows, places = [JOINT_INDEX[name] for name in joints], np.array([uv[:2] for uv in joints.values()])
    each = [
        np.stack([(project(one, camera)[rows] - places) / height for one in pair[:2]], axis=1)
        for pair in people
    ]
    best = min(each, key=mean_of_answer)
    return [best] if mean_of_answer(best) < FAR else []


def mean_of_answer(off: np.ndarray) -> float:
    """Mean distance of one person's answered joints (joints, 2, 2)."""
    return float(np.linalg.norm(off[:, 0], axis=-1).mean())


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
    print("| data | joints | answers | proposals | without the common offset, or within one deviation |")
    print("|---|---|---|---|---|")
    compared = 0
    for folder in arguments.data:
        paths = sorted(folder.glob("*.mcap"))
        for fits, measure, describe in KINDS:
            some = [measure(pipeline, path) for path in paths if fits(path)]
            if some:
                off = np.concatenate(some)
                print(f"| {folder.name} | {len(off)} | {describe(off)} |", flush=True)
                compared += len(off)
    if not compared:
        raise InputError("the folders have no recordings with a truth, references or a tracker's joints")


def of_truth(off: np.ndarray) -> str:
    """Summarise distances from the truth (joints, 4), three columns."""
    cells = [f"{1000 * one.mean():.1f} mm, {(one < 0.1).mean():.3f}" for one in off[:, :2].T]
    across, along = (off[:, 2:] < 1.0).mean(axis=0)
    return " | ".join([*cells, f"{across:.2f} in the plane, {along:.2f} in depth"])


def of_image(off: np.ndarray) -> str:
    """Summarise offsets in the image (joints, 2, 2), three columns."""
    alike = off - np.median(off, axis=0)
    cells = [shares(offsets[:, which]) for offsets in (off, alike) for which in (0, 1)]
    return " | ".join([*cells[:2], f"{cells[2]}; {cells[3]}"])


def shares(offsets: np.ndarray) -> str:
    """Shares of offsets (joints, 2) within .10 and .05 of the height."""
    far = np.linalg.norm(offsets, axis=1)
    return f"{(far < 0.10).mean():.3f} / {(far < 0.05).mean():.3f}"


def of_tracker(off: np.ndarray) -> str:
    """Summarise offsets from another tracker (joints, 2, 3), three columns."""
    cells = [
        f"{1000 * STANDING_M * np.linalg.norm(one, axis=1).mean():.1f} mm, {shares(one)}"
        for one in np.moveaxis(off, 1, 0)
    ]
    return " | ".join([*cells, ""])


def has_truth(path: Path) -> bool:
    """Whether a truth file with all joints is beside a recording."""
    file = path.with_suffix(".npz")
    return file.exists() and set(JOINTS) <= set(load_known_people(file).names)


def has_tracker(path: Path) -> bool:
    """Whether another tracker's joints are beside a recording."""
    return path.with_suffix(".npz").exists() and not has_truth(path)


KINDS = (
    (has_truth, against_truth, of_truth),
    (has_tracker, against_tracker, of_tracker),
    (lambda path: path.with_suffix(".json").exists(), against_image, of_image),
    (lambda path: path.with_name(CUT_OUT).exists(), against_cut_out, of_image),
)
"""Whether a recording has a reference, how to compare with it, and how to summarise."""


if __name__ == "__main__":
    main()
