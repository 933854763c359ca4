"""Two passes over a recording: forward, which learns people's builds, and backward, with all builds known.

The second pass processes the people of the first one backwards, as if time continued from the last frame:
tracks, builds and poses continue, so information from later frames reaches earlier ones. `join` then chooses
one path through both results of each person (Viterbi 1967): a frame costs its lack of confidence, a step its
movement. Where both results are close, their mean is taken: the low-pass filter lags behind in either
direction, so the mean does not.
"""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import Tracking
from depth_pose.pipeline import FrameResult, PosePipeline
from depth_pose.track.packed_people import pack_people, unpack_people
from depth_pose.track.person_view import FramePeople

_STEP_M = 0.1
"""Mean movement of the joints between two frames (m) that costs as much as a confidence of 1/e; set by
hand."""

_SAME_M = 0.06
"""Distance (m) between both results for a joint at which the other has half the weight of the chosen one;
set by hand."""

_LEAST_CONFIDENCE = 0.01
"""Confidences are clipped to this, so that costs are finite."""

_TURN_NS = 33_000_000
"""Time step (ns) at the turn, from the last frame to itself: about one frame."""


@dataclass(frozen=True)
class Gain:
    """Changes made by the second pass.

    Attributes
    ----------
    skeletons : int
        Skeletons in the joined result.
    added : int
        Skeletons that only the second pass has.
    replaced : int
        Skeletons of the second pass that replace one of the first.
    confidence : (2,) tuple of float
        Mean confidence of the joints in the first pass, and in the joined result.
    """

    skeletons: int
    added: int
    replaced: int
    confidence: tuple[float, float]

    def __str__(self) -> str:
        before, now = self.confidence
        return (
            f"{self.replaced} of {self.skeletons} skeletons replaced, {self.added} added; "
            f"confidence of the joints {before:.3f} -> {now:.3f}"
        )


@dataclass(frozen=True)
class Joined:
    """Joined result of both passes for one frame: all skeletons, and that of the followed person."""

    skeletons: tuple[Skeleton, ...]
    skeleton: Skeleton


class SecondPass:
    """Plays a recording back after the first pass.

    Parameters
    ----------
    pipeline : PosePipeline
        That of the first pass.

    Attributes
    ----------
    gain : Gain or None
        None until all frames are joined.
    """

    def __init__(self, pipeline: PosePipeline) -> None:
        self.gain: Gain | None = None
        self._pipeline = pipeline

    def run(self, results: Iterable[FrameResult], progress: Callable[[], None]) -> Iterator[Joined]:
        """Run the first pass to its end, play it back, and yield the joined results in order.

        Parameters
        ----------
        results : iterable of FrameResult
            The first pass.
        progress : callable
            Called after each frame of the second pass.

        Raises
        ------
        InputError
            If the disk has no room for the people of all frames.
        """
        pipeline = self._pipeline
        forward, backward = [], []
        with pipeline.keeping_builds(), _Spool() as spool:
            for result in results:
                spool.add(result.people)
                forward.append(Joined(result.skeletons, result.skeleton))
            unanswered, doubtful = pipeline.unanswered, pipeline.recoverer.doubtful
            for people in spool.played_back():
                again = pipeline.answer(people).skeletons
                backward.append([_played(s, spool.time_of(people.stamp_ns)) for s in again])
                progress()
        everybody, self.gain = join([one.skeletons for one in forward], backward[::-1])
        answered = sum(
            not first.skeletons and bool(joined) for first, joined in zip(forward, everybody, strict=True)
        )
        pipeline.unanswered, pipeline.recoverer.doubtful = unanswered - answered, doubtful
        pipeline.follower.reset()
        for one, skeletons in zip(forward, everybody, strict=True):
            stamp_ns, frame_id = one.skeleton.stamp_ns, one.skeleton.frame_id
            yield Joined(skeletons, pipeline.follower.choose(skeletons, stamp_ns, frame_id))


class _Spool:
    """The people of all frames, in a temporary file: about 100 kB a frame and person."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="depth_pose_")  # noqa: SIM115
        self._starts: list[int] = []
        self._last_ns = 0

    def __enter__(self) -> _Spool:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, people: FramePeople) -> None:
        """Append a frame."""
        self._last_ns = people.stamp_ns
        self._starts.append(self._file.tell())
        try:
            pickle.dump(pack_people(people), self._file)
            self._file.flush()
        except OSError as error:
            raise InputError(
                f"{tempfile.gettempdir()} has no room for what the second pass needs ({error.strerror}): "
                "let TMPDIR name a folder with more, or give --passes 1"
            ) from error

    def played_back(self) -> Iterator[FramePeople]:
        """Yield the frames from the last to the first, with stamps that continue from the last one."""
        for start in reversed(self._starts):
            self._file.seek(start)
            packed = pickle.load(self._file)  # our own file
            yield unpack_people(packed._replace(stamp_ns=self.time_of(packed.stamp_ns)))

    def time_of(self, stamp_ns: int) -> int:
        """Return the stamp at which a frame is played back, or that of a frame that was played back."""
        return 2 * self._last_ns + _TURN_NS - stamp_ns


def join(
    forward: Sequence[Sequence[Skeleton]], backward: Sequence[Sequence[Skeleton]]
) -> tuple[list[tuple[Skeleton, ...]], Gain]:
    """Join the results of both passes.

    Parameters
    ----------
    forward, backward : sequence of sequence of Skeleton
        Skeletons in each frame, in the order of the recording; a person has the same body id in both.

    Returns
    -------
    list of tuple of Skeleton
        Skeletons in each frame, ordered as in the first pass.
    Gain
    """
    named = [[{s.body_id: s for s in frame} for frame in passed] for passed in (forward, backward)]
    answers: list[dict[str, Skeleton]] = [{} for _ in forward]
    added = replaced = 0
    for body_id in dict.fromkeys(b for passed in named for frame in passed for b in frame):
        frames = [n for n in range(len(forward)) if any(body_id in passed[n] for passed in named)]
        both = [tuple(passed[n].get(body_id) for passed in named) for n in frames]
        for n, choice, pair in zip(frames, _path(both), both, strict=True):
            chosen, other = pair[choice], pair[1 - choice]
            assert chosen is not None, "the path uses frames with an answer"
            added += pair[0] is None
            replaced += choice == 1 and other is not None
            joined = chosen if other is None else _mean(chosen, other)
            tracking = Tracking.TRACKED if pair[0] is None else pair[0].tracking
            answers[n][body_id] = replace(joined, tracking=tracking)
    everybody = [tuple(frame.values()) for frame in answers]
    first = _confidence(forward)
    return everybody, Gain(sum(map(len, everybody)), added, replaced, (first, _confidence(everybody)))


def _path(both: Sequence[tuple[Skeleton | None, ...]]) -> list[int]:
    """Choose one of two results in each frame, at the least cost of frames and steps."""
    cost = np.array([_lack(s) for s in both[0]])
    came = np.zeros((len(both), 2), np.int64)
    for n in range(1, len(both)):
        steps = np.array([[_step(a, b) for a in both[n - 1]] for b in both[n]])  # (to, from)
        total = steps + cost
        came[n] = total.argmin(axis=1)
        cost = total.min(axis=1) + np.array([_lack(s) for s in both[n]])
    path = [int(cost.argmin())]
    for n in range(len(both) - 1, 0, -1):
        path.append(int(came[n, path[-1]]))
    return path[::-1]


def _lack(skeleton: Skeleton | None) -> float:
    """Compute the cost of a result from its joints' confidence; very high without a result."""
    if skeleton is None:
        return 1e6
    return -float(np.log(max(float(skeleton.joint_confidence.mean()), _LEAST_CONFIDENCE)))


def _step(before: Skeleton | None, now: Skeleton | None) -> float:
    if before is None or now is None:
        return 0.0
    return float(np.linalg.norm(now.positions - before.positions, axis=1).mean()) / _STEP_M


def _mean(chosen: Skeleton, other: Skeleton) -> Skeleton:
    """Return the mean of two results, joint by joint; the farther the other is, the less weight it has."""
    apart: NDArray[np.float64] = other.positions - chosen.positions
    near = 1.0 / (1.0 + (apart**2).sum(axis=1) / _SAME_M**2)
    share = (near / (1.0 + near))[:, None]
    velocities = chosen.velocities if len(chosen.velocities) else other.velocities
    if len(chosen.velocities) and len(other.velocities):
        velocities = velocities + share * (other.velocities - velocities)
    return replace(chosen, positions=chosen.positions + share * apart, velocities=velocities)


def _played(skeleton: Skeleton, stamp_ns: int) -> Skeleton:
    """Return a skeleton that was found backwards, at its time in the recording."""
    return replace(skeleton.at(stamp_ns), velocities=-skeleton.velocities)


def _confidence(frames: Sequence[Sequence[Skeleton]]) -> float:
    values = [s.joint_confidence.mean() for frame in frames for s in frame]
    return float(np.mean(values)) if values else float("nan")
