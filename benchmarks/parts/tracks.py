"""Constants of the tracks, halved and doubled, on everything that the finder finds in whole recordings.

    python benchmarks/accuracy.py tracks DATA DATA2

Who is who depends on the detections alone, so recordings are segmented once and each constant is tried by
assigning the ids again. A row has, for half and for double: the change of the number of people who are found
(the truth's people whose measured joints have an id), of false ones, of changes of id, and of the number of
ids in all recordings, also those without a truth file. "same" is a run in which every id and every person
probability is equal.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from command_line import make_parser
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.stamps import StampGuard, StampStep
from depth_pose.detect.learned_segmenter import LearnedSegmenter
from depth_pose.detect.segmentation import Detection
from depth_pose.evaluate.score_people import match_people, score_matches
from depth_pose.evaluate.truth import KnownPeople, load_known_people
from depth_pose.io.mcap_read import DepthReader
from depth_pose.track.tracks import PeopleTracks
from parts.changed_constant.factors import FACTORS, times
from parts.constants import changed, constants, shown

_MODULES = ("track.likeness.", "track.tracks.", "track.person_odds.", "track.state.")


class Named(NamedTuple):
    """A detection with an id, scored like a skeleton."""

    body_id: str
    positions: NDArray[np.float32]


class Clip(NamedTuple):
    """The detections of a recording, whether the camera stands still, and the truth if there is one."""

    truth: KnownPeople | None
    frames: list[tuple[int, tuple[Detection, ...], bool, StampStep]]


def load(path: Path, segmenter: LearnedSegmenter) -> Clip:
    """Segment a recording."""
    segmenter.reset()
    guard, frames = StampGuard(), []
    for frame in DepthReader(path):
        step = guard.step(frame.stamp_ns)
        if step in (StampStep.BREAK, StampStep.SILENCE):
            segmenter.reset()
        seen = segmenter.segment(frame)
        frames.append((frame.stamp_ns, seen.detections, seen.is_still, step))
    truth = path.with_suffix(".npz")
    return Clip(load_known_people(truth) if truth.exists() else None, frames)


class Result(NamedTuple):
    """Numbers of people found, false people, changes of id and ids; and all ids with their probability."""

    numbers: NDArray[np.int64]
    names: list[tuple[str | None, float]]


def assign(clips: list[Clip]) -> Result:
    """Assign the ids of all recordings."""
    matches, names, ids = [], [], 0
    for clip in clips:
        tracks, answers, known = PeopleTracks(), {}, set()
        for stamp_ns, detections, is_still, step in clip.frames:
            if step is StampStep.BREAK:
                tracks.reset()
            given = tracks.assign(detections, stamp_ns, is_still)
            names += [(name, tracks.probability(name or "")) for name in given]
            known |= set(given) - {None}
            answers[stamp_ns] = [
                Named(name, d.measured.places)
                for name, d in zip(given, detections, strict=True)
                if name is not None and d.measured is not None
            ]
        ids += len(known)
        if clip.truth is not None:
            matches.append(match_people(clip.truth, answers))
    score = score_matches(matches)
    return Result(np.array([score.found, score.false, score.switches, ids]), names)


def main() -> None:
    """Run and report."""
    parser = make_parser(__doc__)
    parser.add_argument("data", type=Path, nargs="+", help="folders of recordings")
    arguments = parser.parse_args()
    segmenter = LearnedSegmenter(SegmentConfig())
    clips = [load(path, segmenter) for folder in arguments.data for path in sorted(folder.glob("*.mcap"))]
    base = assign(clips)
    print("{} found, {} false, {} changes of id, {} ids; half, double:".format(*base.numbers))
    print(f"| | value |{' found | false | changes | ids |' * 2}\n|{'---|' * 10}")
    for name, value, results in results_of(clips):
        told = [
            "same | | |" if names == base.names else " | ".join(f"{n:+d}" for n in numbers - base.numbers)
            for numbers, names in results
        ]
        print(f"| {name} | {shown(value)} | {' | '.join(told)} |", flush=True)


def results_of(clips: list[Clip]) -> Iterator[tuple[str, Any, list[Result]]]:
    """Give each constant's name, value, and results for half and double."""
    for name, module, variable, value in constants():
        if name.startswith(_MODULES):
            results = []
            for factor in FACTORS:
                with changed(module, variable, times(value, factor)):
                    results.append(assign(clips))
            yield name, value, results
