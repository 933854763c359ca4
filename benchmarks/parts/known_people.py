"""Functions shared by the bank's benchmarks: people with known joints, matching them, and errors."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from depth_pose.bank import Bank
from depth_pose.core.config import PersonalConfig, PipelineConfig
from depth_pose.core.errors import InputError
from depth_pose.core.pose_match import PoseMatch
from depth_pose.core.skeleton import JOINT_NODES, JOINTS
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader
from depth_pose.match.match import Matcher
from depth_pose.match.tuning import MatchTuning
from depth_pose.perception import Perception
from depth_pose.refine.refine import Refiner
from depth_pose.refine.tuning import RefineTuning
from depth_pose.stages import StageFactory
from depth_pose.track.person_view import FramePeople
from depth_pose.tuning import Tuning

RIGHT_M = 0.1
"""A match whose joints are off by less than this on average counts as right, metres."""
LEFT = [j for j, name in enumerate(JOINTS) if name in ("left_shoulder", "left_hip")]
RIGHT = [j for j, name in enumerate(JOINTS) if name in ("right_shoulder", "right_hip")]


@dataclass(frozen=True)
class Recording:
    """The one person of a recording, where found, frame by frame, and the known joints, (T, 19, 3) metres."""

    name: str
    people: list[FramePeople]
    joints: np.ndarray


def make_matcher(bank: Bank, tuning: MatchTuning, scale: float = 0.0) -> Matcher:
    """Build the pipeline's matcher by itself."""
    config = PipelineConfig(build=PersonalConfig(scale=scale))
    return StageFactory(bank, config, Tuning(match=tuning)).make_matcher()


def load_recording(path: Path, step: int = 1) -> Recording:
    """Extract the person of every frame, and keep every ``step``-th."""
    truth = load_truth(path.with_suffix(".npz"))
    config = PipelineConfig()
    perception = Perception(config.segment, config.denoise)
    found, joints = [], []
    for i, frame in enumerate(DepthReader(path)):
        people = perception.perceive(frame)
        if i % step == 0:
            known = truth.joints[int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))]
            found.append(_nearest(people, known))
            joints.append(known)
    return Recording(path.stem, found, np.array(joints, np.float64))


def _nearest(people: FramePeople, known: np.ndarray) -> FramePeople:
    """Keep the person nearest to the known joints."""
    middle = known.mean(axis=0)
    near = sorted(people.persons, key=lambda p: float(np.linalg.norm(np.median(p.points, axis=0) - middle)))
    return replace(people, persons=tuple(near[:1]))


def recordings(folder: Path, largest_width: int = 200) -> list[Path]:
    """List recordings with a truth file and images of at most this width (time of flight)."""
    found = []
    for path in sorted(folder.glob("*.mcap")):
        if path.with_suffix(".npz").exists():
            frame = next(iter(DepthReader(path)))
            if frame.camera.width <= largest_width:
                found.append(path)
    if not found:
        raise InputError(f"{folder} has no recordings with truth files")
    return found


def read_arguments(parser: argparse.ArgumentParser, step: int) -> tuple[argparse.Namespace, list[Recording]]:
    """Add data, banks and step to the options, read them, and load the recordings."""
    parser.add_argument("data", type=Path, help="folder of NAME.mcap with NAME.npz")
    parser.add_argument("banks", nargs="+", metavar="LABEL=FILE")
    parser.add_argument("--step", type=int, default=step, help="use every n-th frame")
    arguments = parser.parse_args()
    recorded = [load_recording(path, arguments.step) for path in recordings(arguments.data)]
    print(f"{sum(len(r.people) for r in recorded)} frames of {len(recorded)} recordings")
    return arguments, recorded


def match_frames(
    bank: Bank, recording: Recording, scale: float, shortlist: int = MatchTuning().shortlist
) -> Iterator[tuple[FramePeople, np.ndarray, PoseMatch, float]]:
    """Match each frame by itself; yield those with a match: person, known joints, match, seconds of CPU."""
    matcher = make_matcher(bank, MatchTuning(shortlist=shortlist, search_every=1), scale)
    for people, known in zip(recording.people, recording.joints, strict=True):
        start = time.thread_time()
        matches = matcher.match(people)
        taken = time.thread_time() - start
        for match in matches:
            yield people, known, match, taken


def compare_frames(bank: Bank, recording: Recording, scale: float) -> np.ndarray:
    """Match and refine each frame by itself; `compare`'s numbers and seconds of matching, (F, 5)."""
    refiner = StageFactory(bank, tuning=Tuning(refine=RefineTuning(track=False))).make_refiner()
    rows = [
        (*compare(bank, refiner, people, known, match), taken)
        for people, known, match, taken in match_frames(bank, recording, scale)
    ]
    return np.array(rows, float).reshape(-1, 5)


def compare(
    bank: Bank, refiner: Refiner, people: FramePeople, known: np.ndarray, match: PoseMatch
) -> tuple[float, bool, float, bool]:
    """Compute error (m) and flip of the best match, and of its refinement."""
    (refined,) = refiner.refine(people, (match,))
    found = joints_of(bank, match), refined.body.nodes[JOINT_NODES]
    first, last = ((mean_error(f, known), is_flipped(f, known)) for f in found)
    return *first, *last


def find_scale(bank: Bank, people: list[FramePeople]) -> float:
    """Body scale that the matcher finds over its first frames."""
    matcher = make_matcher(bank, MatchTuning(search_every=1))
    scale = 1.0
    for frame in people[: MatchTuning().scale_frames]:
        for match in matcher.match(frame):
            scale = match.scale
    return scale


def joints_of(bank: Bank, match: PoseMatch, rank: int = 0) -> np.ndarray:
    """Joints of a candidate as placed by the matcher, (19, 3), camera frame, metres."""
    pose = bank.pose(match.candidates[rank], match.scale)
    return bank.body.pose(pose.rotations, pose.root, pose.scale).nodes[JOINT_NODES]


def mean_error(found: np.ndarray, known: np.ndarray) -> float:
    """Mean distance of joints, metres."""
    return float(np.linalg.norm(found - known, axis=-1).mean())


def is_flipped(found: np.ndarray, known: np.ndarray) -> bool:
    """Whether left and right are swapped, or front and back."""
    across = [j[LEFT].mean(axis=0) - j[RIGHT].mean(axis=0) for j in (found, known)]
    return float(across[0] @ across[1]) < 0.0


def subsample(bank: Bank, share: int) -> Bank:
    """Keep every ``share``-th pose of a bank, and its subspace."""
    rows = np.arange(0, bank.poses, share)
    return Bank(
        body=bank.body,
        pose_quats=bank.pose_quats[rows],
        view_quats=bank.view_quats[rows],
        view_origins=bank.view_origins[rows],
        coefficients=bank.coefficients[rows],
        mean=bank.mean,
        components=bank.components,
        source=bank.source,
    )
