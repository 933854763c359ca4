"""Errors of one, two and three cameras on the same people at the same moments: `benchmarks/rooms.py`."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from depth_pose.bank import Bank, default_bank_path
from depth_pose.core.config import PipelineConfig
from depth_pose.core.result import Skeleton
from depth_pose.evaluate.score_people import PeopleScore, match_people, score_matches
from depth_pose.evaluate.truth import KnownPeople
from depth_pose.io.image_options import ImageOptions
from depth_pose.rooms.fusion import RoomFusion
from depth_pose.rooms.merger import RoomMerger
from depth_pose.rooms.offline import in_order
from depth_pose.rooms.rigfile import Rig, load_rig
from depth_pose.rooms.watching import Watch, Watched, watch_all

VISIBLE, REACH_M = 0.3, 0.4
"""Least visible share of a person that is compared, and maximum mean joint distance of a pair, metres."""

NEAR_NS = 35_000_000
"""Maximum time between truth and answer, nanoseconds."""

HEAD = (
    f"{'room':10} {'cameras':7} {'how':6} {'hidden: one, several':>24} {'seen: one, several':>20} "
    f"{'all mm':>8} {'found':>6} {'false':>5} {'IDF1':>6} {'ms':>6}"
)
"""Head of the table; millimetres."""

Answers = dict[int, tuple[Skeleton, ...]]
Errors = dict[tuple[int, int], np.ndarray]
"""Joint errors (19,) in millimetres by frame and person of the truth."""


def chosen(rig: Rig, cameras: Sequence[int]) -> Rig:
    """Return some cameras of a rig."""
    return replace(
        rig,
        cameras=tuple(rig.cameras[c] for c in cameras),
        topics=tuple(rig.topics[c] for c in cameras),
        clock_offsets=tuple(rig.clock_offsets[c] for c in cameras),
        frame_ids=tuple(rig.frame_ids[c] for c in cameras),
    )


def fitted(bank: Bank, rig: Rig, watched: Sequence[Watched]) -> tuple[Answers, float]:
    """Answer at the frames of the first camera, one body fitted to all; also the median time, ms."""
    fusion, answers, times = RoomFusion(bank, rig), Answers(), []
    for stamp_ns, camera, frame in in_order(watched, fusion.room_stamp):
        start = time.perf_counter()
        fusion.take(camera, frame)
        if camera == 0:
            answers[stamp_ns] = fusion.answer(stamp_ns).skeletons
            times.append(time.perf_counter() - start)
    return answers, 1e3 * float(np.median(times))


def merged(rig: Rig, watched: Sequence[Watched]) -> tuple[Answers, float]:
    """The same, with the cameras' skeletons merged by their covariances."""
    names, places = [c.name for c in rig.cameras], [c.T_room_camera for c in rig.cameras]
    merger, answers, times = RoomMerger(names, places, clock_offsets_s=rig.clock_offsets), Answers(), []
    for stamp_ns, camera, frame in in_order(watched, merger.room_stamp_ns):
        start = time.perf_counter()
        merger.add(camera, frame.stamp_ns, frame.skeletons)
        if camera == 0:
            answers[stamp_ns] = merger.skeletons_at(stamp_ns)
            times.append(time.perf_counter() - start)
    return answers, 1e3 * float(np.median(times))


def errors_of(answers: Answers, truth: Mapping[str, np.ndarray]) -> Errors:
    """Pair answers with true people; return the errors of the joints."""
    stamps, found = np.array(sorted(answers)), Errors()
    for t, stamp in enumerate(truth["stamps_ns"]):
        at = int(stamps[np.abs(stamps - stamp).argmin()])
        if abs(at - stamp) > NEAR_NS or not answers[at]:
            continue
        apart = np.stack([s.positions for s in answers[at]])[None] - truth["joints"][t][:, None]
        distance = np.linalg.norm(apart, axis=-1)
        mean = distance.mean(axis=-1)
        for person, answer in zip(*linear_sum_assignment(mean), strict=True):
            if mean[person, answer] < REACH_M:
                found[t, int(person)] = 1e3 * distance[person, answer]
    return found


def compare(
    truth: Mapping[str, np.ndarray], cameras: Sequence[int], alone: Sequence[Errors], together: Errors
) -> tuple[float, ...]:
    """Return mean errors of one camera and of several, of joints hidden from it and seen by it, millimetres.

    Only of people whom all of the cameras see, and who are found by all answers.
    """
    sums: list[list[float]] = [[], [], [], []]
    for camera, errors in zip(cameras, alone, strict=True):
        for (t, person), own in errors.items():
            is_shared = (truth["visible_by"][list(cameras), t, person] > VISIBLE).all()
            if not is_shared or (t, person) not in together:
                continue
            seen = truth["seen_by"][camera, t, person].astype(bool)
            for k, part in enumerate((~seen, seen)):
                sums[2 * k] += own[part].tolist()
                sums[2 * k + 1] += together[t, person][part].tolist()
    return tuple(float(np.mean(s)) if s else float("nan") for s in sums)


def scored(answers: Answers, truth: Mapping[str, np.ndarray], cameras: Sequence[int]) -> PeopleScore:
    """Score people, ids and joints; a person counts who is visible to one of the cameras."""
    stamps = np.array(sorted(answers))
    near = {int(s): answers[int(stamps[np.abs(stamps - s).argmin()])] for s in truth["stamps_ns"]}
    visible = truth["visible_by"][list(cameras)].max(axis=0)
    known = KnownPeople(truth["joints"], tuple(truth["names"]), truth["stamps_ns"], visible)
    return score_matches([match_people(known, near)])


def fusion(
    folder: Path, names: Sequence[str], rigs: Path | None, tell: Callable[[str], None] = print
) -> None:
    """Fuse every simulated room of a folder, with the true rigs or those of another folder; print a table."""
    bank, ratios = Bank.load(default_bank_path()), dict[tuple[str, int], list[float]]()
    tell(HEAD)
    for file in sorted(folder.glob("*.yaml")):
        if names and file.stem not in names:
            continue
        truth = dict(np.load(file.with_suffix(".npz")))
        rig = load_rig(file if rigs is None else rigs / file.name)
        if rigs is None:
            rig = replace(rig, clock_offsets=tuple(map(float, truth["clock_offsets_s"])))
        recordings = sorted(folder.glob(f"{file.stem}_?.mcap"))
        with tempfile.TemporaryDirectory() as spools:
            watch = Watch(default_bank_path(), PipelineConfig(), None, ImageOptions())
            watched = watch_all(recordings, watch, Path(spools), 0)
            for row in _rows_of_room(bank, rig, watched, truth):
                errors, cameras, how, score, ms = row
                one, several, one_seen, several_seen = errors
                ratios.setdefault((how, len(cameras)), []).append(several / one)
                tell(
                    f"{file.stem:10} {'+'.join(map(str, cameras)):7} {how:6} {one:8.1f} {several:6.1f} "
                    f"({several / one:5.2f}) {one_seen:13.1f} {several_seen:6.1f} {score.mean_error_mm:8.1f} "
                    f"{score.recall:6.3f} {score.false:5d} {score.idf1:6.3f} {ms:6.1f}"
                )
    for (how, count), found in sorted(ratios.items()):
        tell(f"median ratio of hidden joints, {count} cameras, {how}: {np.median(found):.2f} of {len(found)}")


Row = tuple[tuple[float, ...], tuple[int, ...], str, PeopleScore, float]
"""Errors by `compare`, cameras, method, score, and milliseconds."""


def _rows_of_room(
    bank: Bank, rig: Rig, watched: Sequence[Watched], truth: Mapping[str, np.ndarray]
) -> Iterator[Row]:
    """Yield a row for each set of cameras with the first one, whose frames the truth is at."""
    everyone = range(len(watched))
    alone = [errors_of(fitted(bank, chosen(rig, [c]), [watched[c]])[0], truth) for c in everyone]
    for count in range(2, len(watched) + 1):
        for cameras in combinations(everyone, count):
            if cameras[0] != 0:
                continue
            part, seen = chosen(rig, cameras), [watched[c] for c in cameras]
            for how, (answers, ms) in (("fit", fitted(bank, part, seen)), ("merge", merged(part, seen))):
                errors = compare(truth, cameras, [alone[c] for c in cameras], errors_of(answers, truth))
                yield errors, cameras, how, scored(answers, truth, cameras), ms
