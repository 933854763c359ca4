"""Accuracy of estimated bone lengths after 2 to 10 seconds, and their repeatability.

    python benchmarks/accuracy.py builds --people 4 --seconds 12

Simulates each person in two motions before the time-of-flight sensor (builds, motions and views at random),
follows each clip from its first frame with the default bank, and compares the lengths of nine bones with the
person's: the median over bones and clips of the difference, as a share of the true length; and between a
person's two clips at their ends.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from command_line import make_parser

from depth_pose.bank import Bank, default_bank_path
from depth_pose.body.build import BuildSpace
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.motion.procedural.generator import CLIPS, make_clip
from depth_pose.pipeline import PosePipeline
from depth_pose.sim.config import Person, Placement, Room
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.simulate import Stage, simulate

BONES = {
    "trunk": ("pelvis", "neck"),
    "neck and head": ("neck", "head"),
    "shoulders": ("left_shoulder", "right_shoulder"),
    "hips": ("left_hip", "right_hip"),
    "upper arm": ("left_shoulder", "left_elbow"),
    "forearm": ("left_elbow", "left_wrist"),
    "thigh": ("left_hip", "left_knee"),
    "shank": ("left_knee", "left_ankle"),
    "foot": ("left_ankle", "left_foot"),
}
MOMENTS_S = (2.0, 5.0, 10.0)
"""Times of comparison, seconds from the first frame."""
_ENDS = np.array([[JOINT_INDEX[a], JOINT_INDEX[b]] for a, b in BONES.values()]).T


def lengths(joints: np.ndarray) -> np.ndarray:
    """Lengths of the bones of joints (19, 3), metres."""
    return np.linalg.norm(joints[_ENDS[0]] - joints[_ENDS[1]], axis=1)


def sample_person(rng: np.random.Generator) -> Person:
    """Sample a person; proportions vary by a few per cent, as in real people."""
    part = rng.normal(0.0, 1.0, 6)
    return Person(
        stature=float(np.clip(1.68 + 0.12 * part[0], 1.4, 1.95)),
        girth=float(1.0 + 0.08 * part[1]),
        shoulder_width=float(1.0 + 0.04 * part[2]),
        hip_width=float(1.0 + 0.05 * part[3]),
        leg_length=float(1.0 + 0.03 * part[4]),
        arm_length=float(1.0 + 0.03 * part[5]),
    )


def follow(pipeline: PosePipeline, space: BuildSpace, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the bone lengths found at `MOMENTS_S` and at the end, (M + 1, 9), and the true ones, (9,)."""
    truth = load_truth(path.with_suffix(".npz"))
    pipeline.reset()
    found = np.full((len(MOMENTS_S) + 1, len(BONES)), np.nan)
    for frame in DepthReader(path):
        skeleton = pipeline.process_frame(frame).skeleton
        if skeleton.is_lost:
            continue
        own = lengths_of(space, skeleton)
        seconds = (frame.stamp_ns - int(truth.stamps_ns[0])) * 1e-9
        for k, moment in enumerate(MOMENTS_S):
            if seconds <= moment:
                found[k] = own
        found[-1] = own
    return found, np.median([lengths(joints) for joints in truth.joints], axis=0)


def lengths_of(space: BuildSpace, skeleton: Skeleton) -> np.ndarray:
    """Lengths of the bones of a followed person, metres, (9,)."""
    body = space.body(np.asarray(skeleton.build, np.float32)) if len(skeleton.build) else space.template
    return skeleton.scale * lengths(body.nodes[JOINT_NODES])


def main() -> None:
    """Simulate, follow and report."""
    parser = make_parser(__doc__)
    parser.add_argument("--people", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--seed", type=int, default=31)
    arguments = parser.parse_args()
    bank = Bank.load(default_bank_path())
    pipeline, space = PosePipeline(bank), BuildSpace(bank.body)
    pipeline.warm_up()
    names, found, true = sorted(CLIPS), [], []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(2 * arguments.people):
            rng = np.random.default_rng([arguments.seed, k // 2])
            person = sample_person(rng)
            other = np.random.default_rng([arguments.seed, k, 1])
            sensor, name = SENSORS["tof"], names[other.integers(len(names))]
            clip = make_clip(name, sensor.fps, arguments.seconds, seed=5000 + k)
            place = Placement(distance=float(other.uniform(2.6, 3.8)), azimuth=float(other.uniform(-60, 60)))
            path = Path(folder) / f"{k}.mcap"
            simulate(path, person.body(), clip, Stage(sensor, place, Room(floor=False, wall=0.0)), seed=k)
            lengths_found, lengths_true = follow(pipeline, space, path)
            found.append(lengths_found)
            true.append(lengths_true)
            off = np.median(np.abs(lengths_found / lengths_true - 1.0), axis=1)
            print(f"person {k // 2}, {name}: " + ", ".join(f"{100 * o:.1f} %" for o in off), flush=True)
    report(np.array(found), np.array(true))


def report(found: np.ndarray, true: np.ndarray) -> None:
    """Print the medians over clips (K, M + 1, 9), by moment and by bone, and between clips of one person."""
    off = np.abs(found / true[:, None] - 1.0)
    for k, moment in enumerate((*MOMENTS_S, "the end")):
        print(f"after {moment}{' s' if k < len(MOMENTS_S) else ''}: {100 * np.nanmedian(off[:, k]):.1f} %")
    for k, name in enumerate(BONES):
        print(f"    {name} at the end: {100 * np.nanmedian(off[:, -1, k]):.1f} %")
    twice = np.abs(found[0::2, -1] / found[1::2, -1] - 1.0)
    print(
        f"same person twice: {100 * np.nanmedian(twice):.1f} % median, {100 * np.nanmax(twice):.1f} % at most"
    )
