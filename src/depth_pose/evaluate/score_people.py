"""Score the skeletons of several people against their true joints.

In each frame true people and skeletons are assigned to each other with the smallest sum of mean joint
distances; pairs farther apart than `REACH_M` are not matched. A person is expected if at least `ASKED_SHARE`
is visible. A skeleton of a person of whom only `WEAK_SHARE` is visible is not counted as false either.
Skeletons in a room's frame are interpolated to the times of the truth.

IDF1 is that of Ristani et al., *Performance Measures and a Data Set for Multi-Target, Multi-Camera
Tracking*, 2016: each person is assigned the id that matches them longest, and frames with that id count.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.evaluate.truth import (
    STAMP_TOLERANCE_NS,
    KnownPeople,
    load_known_people,
    pair_files,
    require_camera_frame,
)
from depth_pose.io.schemas import PEOPLE_TOPIC
from depth_pose.rooms.recorded import read_recorded

ASKED_SHARE = 0.3
"""Visible share from which a person is expected, as in the development data's scorer."""

WEAK_SHARE = 0.05
"""Minimum visible share at which a skeleton is not counted as false."""

REACH_M = 0.4
"""Maximum mean joint distance of a matched skeleton (m), as in that scorer."""

_FAR_M = 9.0
"""Cost of a forbidden pair in the assignment (m), as in that scorer."""

PCK_M = 0.10
"""Maximum error of a correct joint (m)."""


@dataclass(frozen=True)
class PeopleMatches:
    """One sequence's skeletons, assigned to the people.

    Attributes
    ----------
    frames : int
    asked : int
        People expected, over all frames.
    answered : int
        Skeletons, over all frames.
    false : int
        Skeletons without a person.
    switches : int
        How often a person's id differs from when they were last found.
    identified : int
        Found people under their longest-lasting id.
    errors : (F, J) float64
        Joint errors of the expected people that are found, metres; NaN where a joint is missing.
    """

    frames: int
    asked: int
    answered: int
    false: int
    switches: int
    identified: int
    errors: NDArray[np.float64]


@dataclass(frozen=True)
class PeopleScore:
    """Scores of detection, tracking and joints for several people.

    Attributes
    ----------
    frames, asked, found, false, switches : int
        As in `PeopleMatches`; ``found`` are the expected people with a skeleton.
    recall : float
        Share of the expected people that are found; NaN if nobody is expected.
    precision : float
        Found, as a share of found and false; NaN where there is nothing.
    idf1 : float
        Consistency of ids, 0 to 1; NaN where nobody is expected or found.
    mean_error_mm : float
        Mean joint error of the people found; NaN if there are none.
    pck10 : float
        Share of joints within 10 cm over the expected people; missed people count.
    """

    frames: int
    asked: int
    found: int
    false: int
    switches: int
    recall: float
    precision: float
    idf1: float
    mean_error_mm: float
    pck10: float


@dataclass(frozen=True)
class PeopleScores:
    """All sequences together, and each."""

    total: PeopleScore
    sequences: Mapping[str, PeopleScore]


def match_people(truth: KnownPeople, answers: Mapping[int, Sequence[Skeleton]]) -> PeopleMatches:
    """Assign one sequence's skeletons to its people.

    Parameters
    ----------
    truth : KnownPeople
    answers : mapping of int to sequence of Skeleton
        All skeletons, by stamp in nanoseconds.
    """
    stamps = np.array(sorted(answers), np.int64)
    shared: Counter[tuple[int, str]] = Counter()
    last: dict[int, str] = {}
    errors = [np.zeros((0, len(truth.names)))]
    false = switches = 0
    for joints, visible, stamp in zip(truth.joints, truth.visible, truth.stamps_ns, strict=True):
        skeletons = _answer_at(int(stamp), stamps, answers)
        pairs, distances = _assign(joints, visible >= WEAK_SHARE, skeletons, truth.names)
        false += len(skeletons) - len(pairs)
        for person, which in pairs:
            if visible[person] < ASKED_SHARE:
                continue
            body_id = skeletons[which].body_id
            errors.append(distances[person, which][None])
            shared[person, body_id] += 1
            switches += last.get(person, body_id) != body_id
            last[person] = body_id
    return PeopleMatches(
        frames=len(truth.stamps_ns),
        asked=int((truth.visible >= ASKED_SHARE).sum()),
        answered=sum(len(skeletons) for skeletons in answers.values()),
        false=false,
        switches=switches,
        identified=_count_identified(shared),
        errors=np.concatenate(errors),
    )


def _answer_at(
    stamp_ns: int, stamps: NDArray[np.int64], answers: Mapping[int, Sequence[Skeleton]]
) -> Sequence[Skeleton]:
    if not len(stamps):
        return ()
    nearest = int(stamps[np.argmin(np.abs(stamps - stamp_ns))])
    return answers[nearest] if abs(nearest - stamp_ns) < STAMP_TOLERANCE_NS else ()


def _assign(
    joints: NDArray[np.float64],
    may_answer: NDArray[np.bool_],
    skeletons: Sequence[Skeleton],
    names: tuple[str, ...],
) -> tuple[list[tuple[int, int]], NDArray[np.float64]]:
    """Pair people and skeletons of a frame; also all joint distances, (P, S, J) metres."""
    from scipy.optimize import linear_sum_assignment

    if not len(skeletons):
        return [], np.zeros((len(joints), 0, len(names)))
    order = [JOINT_INDEX[name] for name in names]
    positions = np.stack([s.positions[order] for s in skeletons])
    distances = np.linalg.norm(joints[:, None] - positions[None], axis=-1)
    mean = np.nan_to_num(distances.mean(axis=-1), nan=_FAR_M)
    cost = np.where(may_answer[:, None], mean, _FAR_M)
    rows, columns = linear_sum_assignment(cost)
    pairs = [(int(p), int(s)) for p, s in zip(rows, columns, strict=True) if cost[p, s] <= REACH_M]
    return pairs, distances


def _count_identified(shared: Counter[tuple[int, str]]) -> int:
    """Count the frames under the best one-to-one assignment of ids to people."""
    from scipy.optimize import linear_sum_assignment

    ids = sorted({body_id for _, body_id in shared})
    people = sorted({person for person, _ in shared})
    table = np.array([[shared[person, body_id] for body_id in ids] for person in people])
    return int(table[linear_sum_assignment(-table)].sum()) if table.size else 0


def score_matches(matches: Sequence[PeopleMatches]) -> PeopleScore:
    """Combine sequences."""
    errors = np.concatenate([m.errors for m in matches])
    asked, false = sum(m.asked for m in matches), sum(m.false for m in matches)
    answered = sum(m.answered for m in matches)
    known = errors[np.isfinite(errors)]
    return PeopleScore(
        frames=sum(m.frames for m in matches),
        asked=asked,
        found=len(errors),
        false=false,
        switches=sum(m.switches for m in matches),
        recall=_share(len(errors), asked),
        precision=_share(len(errors), len(errors) + false),
        idf1=_share(2 * sum(m.identified for m in matches), asked + answered),
        mean_error_mm=float(known.mean() * 1e3) if known.size else float("nan"),
        pck10=_share(int((errors < PCK_M).sum()), asked * errors.shape[1]),
    )


def _share(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")


def score_people(truth: Path | str, predicted: Path | str, topic: str = PEOPLE_TOPIC) -> PeopleScores:
    """Score recordings of several people's skeletons against truth files.

    Parameters
    ----------
    truth : Path or str
        A truth file, or a folder of them.
    predicted : Path or str
        A recording, or a folder with ``NAME.mcap`` for every ``NAME.npz``; where one is missing
        its people count as not found.
    topic : str
        Topic of the skeletons. A recording that lacks the default one may have one person's.

    Raises
    ------
    InputError
        Where there is no truth, or no recording at all, or one is in a room's frame and the other in a
        camera's.
    """
    matches = {}
    for path, recording in pair_files(Path(truth), Path(predicted)):
        known = load_known_people(path)
        matches[path.stem] = match_people(known, _answers(known, path, recording, topic))
    return PeopleScores(
        score_matches(list(matches.values())), {name: score_matches([m]) for name, m in matches.items()}
    )


def _answers(known: KnownPeople, truth: Path, path: Path, topic: str) -> Mapping[int, Sequence[Skeleton]]:
    """Read a recording's skeletons, in the frame of the truth."""
    if not path.exists():
        return {}
    people = read_recorded(path, topic)
    if not known.is_room:
        require_camera_frame(path, people.frame_id)
        return people.answers
    if people.answers and not people.is_room:
        raise InputError(
            f"{truth} is in a room's frame, and {path} in a camera's ({people.frame_id!r}): run all cameras' "
            "recordings with `run --rig`"
        )
    at_truth = {int(stamp): people.at(int(stamp)) for stamp in known.stamps_ns}
    return {stamp: skeletons for stamp, skeletons in at_truth.items() if skeletons is not None}
