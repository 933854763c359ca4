"""What the bank's benchmarks share: people with known joints, matching them, and errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from depth_pose.bank import Bank
from depth_pose.core.config import MatchConfig, PipelineConfig
from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINT_NODES, JOINTS
from depth_pose.core.types import PoseMatch
from depth_pose.evaluate.truth import load_truth
from depth_pose.fit.articulated import candidate_pose
from depth_pose.io.mcap_read import DepthReader
from depth_pose.people.person import People
from depth_pose.steps.extract import PeopleExtractor
from depth_pose.steps.match import Matcher

RIGHT_M = 0.1
"""A match whose joints are off by less than this on average counts as right, metres."""
LEFT = [j for j, name in enumerate(JOINTS) if name in ("left_shoulder", "left_hip")]
RIGHT = [j for j, name in enumerate(JOINTS) if name in ("right_shoulder", "right_hip")]


@dataclass(frozen=True)
class Recording:
    """A recording's one person, if found, frame by frame, and known joints, (T, 19, 3) metres."""

    name: str
    people: list[People]
    joints: np.ndarray


def load_recording(path: Path, step: int = 1) -> Recording:
    """Extract the person of every frame, and keep every ``step``-th."""
    truth = load_truth(path.with_suffix(".npz"))
    config = PipelineConfig()
    extractor = PeopleExtractor(config.segment, config.denoise)
    found, joints = [], []
    for i, frame in enumerate(DepthReader(path)):
        people = extractor.extract(frame)
        if i % step == 0:
            known = truth.joints[int(np.argmin(np.abs(truth.stamps_ns - frame.stamp_ns)))]
            found.append(_nearest(people, known))
            joints.append(known)
    return Recording(path.stem, found, np.array(joints, np.float64))


def _nearest(people: People, known: np.ndarray) -> People:
    """Keep whoever is nearest to the known joints."""
    middle = known.mean(axis=0)
    near = sorted(people.persons, key=lambda p: float(np.linalg.norm(np.median(p.points, axis=0) - middle)))
    return replace(people, persons=tuple(near[:1]))


def recordings(folder: Path, largest_width: int = 200) -> list[Path]:
    """Recordings with a truth file whose images are at most so wide (the time-of-flight ones)."""
    found = []
    for path in sorted(folder.glob("*.mcap")):
        if path.with_suffix(".npz").exists():
            frame = next(iter(DepthReader(path)))
            if frame.camera.width <= largest_width:
                found.append(path)
    if not found:
        raise InputError(f"{folder} has no recordings with truth files")
    return found


def find_scale(bank: Bank, people: list[People]) -> float:
    """Size that the matcher finds over its first frames."""
    matcher = Matcher(bank, MatchConfig(search_every=1))
    scale = 1.0
    for frame in people[: MatchConfig().scale_frames]:
        for match in matcher.match(frame):
            scale = match.scale
    return scale


def joints_of(bank: Bank, match: PoseMatch, rank: int = 0) -> np.ndarray:
    """Joints of a candidate where the matcher placed it, (19, 3), camera frame, metres."""
    pose = candidate_pose(bank, match.candidates[rank], match.scale)
    return bank.body.pose(pose.rotations, pose.root, pose.scale).nodes[JOINT_NODES]


def mean_error(found: np.ndarray, known: np.ndarray) -> float:
    """Mean distance of joints, metres."""
    return float(np.linalg.norm(found - known, axis=-1).mean())


def is_flipped(found: np.ndarray, known: np.ndarray) -> bool:
    """Whether the person's left lies on the wrong side: front for back, or left for right."""
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
