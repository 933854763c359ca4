"""Skeletons of several cameras merged by covariances, beside those of single cameras: recordings, not live.

Each recording of a simulated room (``NAME_0.mcap``, ..., with the true rig ``NAME.yaml`` and the truth
``NAME.npz``) is processed by itself and kept in a folder; then the skeletons are merged in the order of
their stamps, and asked for at the stamps of each frame of camera 0. Errors are those of the joints that
camera 0 sees and of those hidden from it, over the people whom it finds.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from depth_pose.core.result import Skeleton
from depth_pose.evaluate.score_people import match_people, score_matches
from depth_pose.evaluate.truth import KnownPeople
from depth_pose.io.skeleton_read import read_people
from depth_pose.rooms.merge import place
from depth_pose.rooms.merger import RoomMerger
from depth_pose.rooms.rigfile import load_rig

REACH_M = 0.4
"""As for `depth_pose.evaluate.score_people`."""


@dataclass(frozen=True)
class Truth:
    """The people of a simulated room, at any stamp of camera 0's clock."""

    stamps_ns: np.ndarray
    joints: np.ndarray
    seen_by: np.ndarray
    visible: np.ndarray
    offsets_s: np.ndarray

    @classmethod
    def load(cls, path: Path) -> Truth:
        with np.load(path) as of:
            return cls(
                of["stamps_ns"],
                of["joints"].astype(np.float64),
                of["seen_by"],
                of["visible_by"].max(axis=0),
                of["clock_offsets_s"],
            )

    def at(self, stamp_ns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return joints (P, 19, 3), seen by each camera (M, P, 19), and the visible share (P,)."""
        k = int(np.clip(np.searchsorted(self.stamps_ns, stamp_ns), 1, len(self.stamps_ns) - 1))
        before, after = self.stamps_ns[k - 1], self.stamps_ns[k]
        share = float(np.clip((stamp_ns - before) / (after - before), 0.0, 1.0))
        near = k if share > 0.5 else k - 1
        joints = (1.0 - share) * self.joints[k - 1] + share * self.joints[k]
        return joints, self.seen_by[:, near], self.visible[near]


def joint_errors(truth: Truth, answers: Mapping[int, Sequence[Skeleton]]) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (F, 19), metres, of the people found, and by how many cameras joints are seen."""
    errors, seen = [np.zeros((0, 19))], [np.zeros((0, len(truth.seen_by), 19), bool)]
    for stamp_ns, skeletons in answers.items():
        seen_by = truth.at(stamp_ns)[1]
        for p, _, distances in _pairs(truth, stamp_ns, skeletons):
            errors.append(distances[None])
            seen.append(seen_by[None, :, p])
    return np.concatenate(errors), np.concatenate(seen)


def ids_of_people(
    truth: Truth, answers: Mapping[int, Sequence[Skeleton]]
) -> tuple[list[list[str]], list[str]]:
    """Return the ids that each true person had, message by message, and those of skeletons without one."""
    people: list[list[str]] = [[] for _ in range(truth.joints.shape[1])]
    others: list[str] = []
    for stamp_ns, skeletons in answers.items():
        pairs = {s: p for p, s, _ in _pairs(truth, stamp_ns, skeletons)}
        for s, skeleton in enumerate(skeletons):
            (people[pairs[s]] if s in pairs else others).append(skeleton.body_id)
    return people, others


def _pairs(
    truth: Truth, stamp_ns: int, skeletons: Sequence[Skeleton]
) -> Iterator[tuple[int, int, np.ndarray]]:
    """Yield the matched person, skeleton, and distances of the joints (19,), metres."""
    if not skeletons:
        return
    joints = truth.at(stamp_ns)[0]
    distances = np.linalg.norm(joints[:, None] - np.stack([s.positions for s in skeletons]), axis=-1)
    mean = distances.mean(axis=-1)
    for p, s in zip(*linear_sum_assignment(mean), strict=True):
        if mean[p, s] <= REACH_M:
            yield int(p), int(s), distances[p, s]


def people_score(truth: Truth, answers: Mapping[int, Sequence[Skeleton]]):
    """Score detection and ids over all answers."""
    from depth_pose.core.skeleton import JOINTS

    stamps = np.array(sorted(answers), np.int64)
    at = [truth.at(int(s)) for s in stamps]
    known = KnownPeople(np.array([a[0] for a in at]), JOINTS, stamps, np.array([a[2] for a in at]))
    return score_matches([match_people(known, answers)])


def process(recording: Path, skeletons: Path) -> Path:
    """Process one camera's recording, unless that has been done."""
    out = skeletons / recording.name
    if not out.is_file():
        from depth_pose.bank import Bank, default_bank_path
        from depth_pose.io.mcap_read import DepthReader
        from depth_pose.offline import process_recording
        from depth_pose.pipeline import PosePipeline

        skeletons.mkdir(parents=True, exist_ok=True)
        pipeline = PosePipeline(Bank.load(default_bank_path()))
        pipeline.warm_up()
        process_recording(DepthReader(recording), out, pipeline)
    return out


def merge(name: Path, skeletons: Path) -> tuple[list[dict], dict, RoomMerger, float]:
    """Return the answers of single cameras in the room's frame, the merged ones, and ms a message."""
    rig = load_rig(name.with_suffix(".yaml"))
    poses = [camera.T_room_camera for camera in rig.cameras]
    merger = RoomMerger([camera.name for camera in rig.cameras], poses)
    offsets = Truth.load(name.with_suffix(".npz")).offsets_s
    singles: list[dict] = [{} for _ in poses]
    events = []
    for camera, T in enumerate(poses):
        path = process(name.with_name(f"{name.name}_{camera}.mcap"), skeletons)
        for message in read_people(path):
            found = tuple(s for s in message.skeletons if not s.is_lost)
            stamp_ns = message.stamp_ns - round(1e9 * offsets[camera])
            singles[camera][stamp_ns] = tuple(place(s, T, "room") for s in found)
            events.append((message.stamp_ns, camera, found))
    merged, spent_s = {}, 0.0
    for stamp_ns, camera, found in sorted(events, key=lambda e: e[:2]):
        began = time.perf_counter()
        merger.add(camera, stamp_ns, found)
        if camera == 0:
            merged[stamp_ns] = merger.skeletons_at(stamp_ns)
        spent_s += time.perf_counter() - began
    return singles, merged, merger, 1e3 * spent_s / len(events)


def report(names: Sequence[Path], skeletons: Path) -> None:
    """Print a row for each single camera, and one for all together."""
    print("| recording | cameras | mm | seen by camera 0 | hidden from it | PCK.10 ", end="")
    print("| precision | recall | IDF1 |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in names:
        truth = Truth.load(name.with_suffix(".npz"))
        singles, merged, merger, ms = merge(name, skeletons)
        for label, answers in (*((str(c), s) for c, s in enumerate(singles)), ("all", merged)):
            errors, seen = joint_errors(truth, answers)
            by_0, score = seen[:, 0], people_score(truth, answers)
            cells = [1e3 * errors.mean(), 1e3 * errors[by_0].mean(), 1e3 * errors[~by_0].mean()]
            shares = [(errors < 0.1).mean(), score.precision, score.recall, score.idf1]
            print(
                f"| {name.name} | {label} | "
                + " | ".join(f"{c:.0f}" for c in cells)
                + " | "
                + " | ".join(f"{s:.3f}" for s in shares)
                + " |"
            )
        for line in merger.watch.news():
            print(f"  {line}")
        offsets = ", ".join(f"{1e3 * o:.0f}" for o in merger.clock_offsets_s)
        print(f"  {ms:.2f} ms a message; clock offsets corrected: {offsets} ms")
