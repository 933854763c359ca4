"""Score skeletons against true joints.

Errors are distances between the true and the estimated position of a joint. A frame is matched with
the skeleton of the nearest stamp, within 2 ms. The mean errors are over
estimated joints; the shares (``pck``, percentage of correct keypoints as a fraction) count a joint or a
frame without an answer as a miss.

Bodies differ in the exact definition of a joint. The offset-free error removes each
joint's constant offset in a frame that turns with the torso: x from the right shoulder and
hip to the left ones, z from pelvis to neck, made orthogonal; the offset is the median over
all frames of all sequences.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINTS
from depth_pose.evaluate.truth import (
    STAMP_TOLERANCE_NS,
    KnownJoints,
    load_truth,
    pair_files,
    require_camera_frame,
)
from depth_pose.io.schemas import SKELETON_TOPIC
from depth_pose.io.skeleton_read import read_skeletons

THRESHOLDS_M = (0.02, 0.03, 0.05, 0.07, 0.10, 0.15, 0.20)
"""Distances at which the share of correct joints is reported (m)."""


@dataclass(frozen=True)
class SequenceErrors:
    """Results of one sequence against its truth; NaN where a frame was not answered.

    Attributes
    ----------
    name : str
    names : tuple of str
        The J joints.
    errors : (T, J) float64
        Distance between known and answered joint, metres.
    offsets : (T, J, 3) float64
        Answered minus known position in the torso's frame, metres.
    seen : (T, J) bool
    """

    name: str
    names: tuple[str, ...]
    errors: NDArray[np.float64]
    offsets: NDArray[np.float64]
    seen: NDArray[np.bool_]


@dataclass(frozen=True)
class JointScore:
    """One joint over all sequences; millimetres, and the share within 10 cm."""

    mean_error_mm: float
    offset_free_mm: float
    pck10: float


@dataclass(frozen=True)
class SequenceScore:
    """One sequence.

    Attributes
    ----------
    frames : int
        Frames of the truth.
    coverage : float
        Share of frames with an answer for every joint.
    mean_error_mm, median_mm, p95_mm : float
        Over answered joints; NaN if there are none.
    pck10 : float
        Share of joints within 10 cm.
    """

    frames: int
    coverage: float
    mean_error_mm: float
    median_mm: float
    p95_mm: float
    pck10: float


@dataclass(frozen=True)
class Score:
    """All sequences together.

    Attributes
    ----------
    frames : int
        Frames of the truth.
    coverage : float
        Share of frames with an answer for every joint.
    mean_error_mm, offset_free_mm, seen_mm, hidden_mm : float
        Mean error over answered joints; without the joints' constant offsets; of joints on the
        side that the sensor sees; of the others. NaN where there are none.
    per_sequence_mean_mm : float
        Mean of the sequences' mean errors.
    pck : mapping of float to float
        Share of joints within each of `THRESHOLDS_M`.
    joints : mapping of str to JointScore
    sequences : mapping of str to SequenceScore
    """

    frames: int
    coverage: float
    mean_error_mm: float
    per_sequence_mean_mm: float
    offset_free_mm: float
    seen_mm: float
    hidden_mm: float
    pck: Mapping[float, float]
    joints: Mapping[str, JointScore]
    sequences: Mapping[str, SequenceScore]

    @property
    def pck10(self) -> float:
        """Share of joints within 10 cm."""
        return self.pck[0.10]


def match_sequence(
    name: str, truth: KnownJoints, answers: Mapping[int, Mapping[str, NDArray[np.float64]]]
) -> SequenceErrors:
    """Compare one sequence's answers with its truth.

    Parameters
    ----------
    name : str
        The sequence's name.
    truth : KnownJoints
        What is known.
    answers : mapping of int to mapping of str to (3,) float64
        Joint positions by name, by stamp in nanoseconds; metres, optical frame.
    """
    answered = np.full(truth.joints.shape, np.nan)
    stamps = np.array(sorted(answers), np.int64)
    for i, stamp in enumerate(truth.stamps_ns if len(stamps) else ()):
        nearest = int(stamps[np.argmin(np.abs(stamps - stamp))])
        if abs(nearest - int(stamp)) > STAMP_TOLERANCE_NS:
            continue
        for j, joint in enumerate(truth.names):
            if joint in answers[nearest]:
                answered[i, j] = answers[nearest][joint]
    difference = answered - truth.joints
    torso = np.stack([torso_axes(joints, truth.names) for joints in truth.joints])
    return SequenceErrors(
        name=name,
        names=truth.names,
        errors=np.linalg.norm(difference, axis=-1),
        offsets=np.einsum("tji,tkj->tki", torso, difference),
        seen=truth.seen,
    )


def torso_axes(joints: NDArray[np.float64], names: tuple[str, ...]) -> NDArray[np.float64]:
    """Axes of the torso in the camera frame, as columns, (3, 3); a missing pelvis is between the hips."""
    at = {name: joints[names.index(name)] for name in names}
    x = at["left_shoulder"] + at["left_hip"] - at["right_shoulder"] - at["right_hip"]
    x = x / np.linalg.norm(x)
    y = np.cross(at["neck"] - at.get("pelvis", 0.5 * (at["left_hip"] + at["right_hip"])), x)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def score_sequences(sequences: list[SequenceErrors]) -> Score:
    """Combine sequences.

    Raises
    ------
    InputError
        Where there are none, or they do not have the same joints.
    """
    if not sequences:
        raise InputError("there is nothing to score")
    names = sequences[0].names
    for sequence in sequences:
        if sequence.names != names:
            raise InputError(f"{sequence.name} has other joints than {sequences[0].name}")
    errors = np.concatenate([s.errors for s in sequences])
    offsets = np.concatenate([s.offsets for s in sequences])
    seen = np.concatenate([s.seen for s in sequences])
    constant = np.stack([[_median(offsets[:, j, c]) for c in range(3)] for j in range(len(names))])
    offset_free = np.linalg.norm(offsets - constant, axis=-1)
    return Score(
        frames=len(errors),
        coverage=_coverage(errors),
        mean_error_mm=_mean_mm(errors),
        per_sequence_mean_mm=_mean([_mean_mm(s.errors) for s in sequences]),
        offset_free_mm=_mean_mm(offset_free),
        seen_mm=_mean_mm(errors[seen]),
        hidden_mm=_mean_mm(errors[~seen]),
        pck={t: float((errors < t).mean()) for t in THRESHOLDS_M},
        joints={
            name: JointScore(
                _mean_mm(errors[:, j]), _mean_mm(offset_free[:, j]), float((errors[:, j] < 0.10).mean())
            )
            for j, name in enumerate(names)
        },
        sequences={s.name: _score_sequence(s.errors) for s in sequences},
    )


def _score_sequence(errors: NDArray[np.float64]) -> SequenceScore:
    known = errors[np.isfinite(errors)] * 1e3
    return SequenceScore(
        frames=len(errors),
        coverage=_coverage(errors),
        mean_error_mm=_mean_mm(errors),
        median_mm=_median(known),
        p95_mm=float(np.percentile(known, 95)) if known.size else float("nan"),
        pck10=float((errors < 0.10).mean()),
    )


def _coverage(errors: NDArray[np.float64]) -> float:
    return float(np.isfinite(errors).all(axis=1).mean())


def _median(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _mean(values: list[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")


def _mean_mm(errors: NDArray[np.float64]) -> float:
    known = errors[np.isfinite(errors)]
    return float(known.mean() * 1e3) if known.size else float("nan")


def score(truth: Path | str, predicted: Path | str, topic: str = SKELETON_TOPIC) -> Score:
    """Score recordings of skeletons against truth files.

    Parameters
    ----------
    truth : Path or str
        A truth file, or a folder of them.
    predicted : Path or str
        A recording, or a folder with ``NAME.mcap`` for every ``NAME.npz``; where one is missing
        its frames count as not answered.
    topic : str
        The skeletons' topic.

    Raises
    ------
    InputError
        Where there is no truth, or no recording at all.
    """
    pairs = pair_files(Path(truth), Path(predicted))
    return score_sequences([match_sequence(t.stem, load_truth(t), read_answers(p, topic)) for t, p in pairs])


def read_answers(path: Path, topic: str = SKELETON_TOPIC) -> dict[int, dict[str, NDArray[np.float64]]]:
    """Read the joints of a recording by stamp and name; empty if there is no recording."""
    if not path.exists():
        return {}
    skeletons = list(read_skeletons(path, topic))
    for skeleton in skeletons[:1]:
        require_camera_frame(path, skeleton.frame_id)
    return {s.stamp_ns: dict(zip(JOINTS, s.positions, strict=False)) for s in skeletons}
