"""Offline runs: every frame of a recording to a skeleton, in order, none dropped."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from depth_pose.core.errors import InputError
from depth_pose.core.outputs import refuse_inputs
from depth_pose.io.mcap_write import SkeletonWriter

if TYPE_CHECKING:
    from depth_pose.detect.floor import Floor
    from depth_pose.passes import Gain, SecondPass

_LONGEST_PAUSE_S = 2.0
"""Longest gap of a recording that is played as a pause, seconds. Set by hand."""

NOTE = "depth_pose"
"""Name of the metadata record with the provenance of an output."""

FLOOR = "depth_pose_floor"
"""Name of the metadata record with the floor's plane, or with `_MOVED` where it changed."""
_MOVED = {"moved": "yes"}
_MOVES = 3.0
"""Change of the floor, as a multiple of its noise, above which the sensor has moved. Set by hand."""
_MOST_CHANGES = 2
"""Maximum number of changes of the floor in a recording of a sensor that stands still: a table is taken for
it until the floor is seen. Set by hand."""


class Reader(Protocol):
    """The frames of a recording, for instance `depth_pose.io.mcap_read.DepthReader`."""

    def __iter__(self) -> Iterator[Any]:
        """Yield the frames in their order."""

    @property
    def path(self) -> Path:
        """The recording's file or folder."""

    @property
    def dropped(self) -> int:
        """Frames that could not be used."""

    @property
    def warnings(self) -> Sequence[str]:
        """Problems, one line each."""


class Method(Protocol):
    """A method from frames to skeletons, for instance `depth_pose.pipeline.PosePipeline`."""

    def reset(self) -> None:
        """Forget all earlier frames."""

    @property
    def warnings(self) -> Sequence[str]:
        """Warnings about the frames since the last reset, one line each."""

    def process_frame(self, frame: Any, /) -> Any:
        """Process one frame.

        The result has all ``skeletons``, the followed person's ``skeleton``, and may have the ``floor``.
        """


@runtime_checkable
class TwoStageMethod(Method, Protocol):
    """A method whose first stage does not depend on the rest, for instance `PosePipeline`."""

    def perceive(self, frame: Any, /) -> Any:
        """Run the first stage on one frame."""

    def conclude(self, perceived: Any, /) -> Any:
        """Return the result of `process_frame` for a frame after the first stage."""


@dataclass(frozen=True)
class RunSummary:
    """Summary of an offline run.

    Attributes
    ----------
    frames : int
        Frames of the recording, including those that could not be used.
    answered : int
        Frames with a skeleton of a person.
    empty : int
        Frames without a person.
    most_people : int
        Most people in one frame.
    dropped : int
        Frames that could not be used; `warnings` say why.
    sources : mapping of str to int
        Number of skeletons by source.
    confidence : float
        Mean of the skeletons' confidences; NaN without any.
    median_ms, p95_ms : float
        Time per frame in the pipeline, milliseconds; NaN without frames.
    warnings : tuple of str
        Problems, one line each with its count.
    gain : Gain or None
        What a second pass changed.
    """

    frames: int
    answered: int
    empty: int
    most_people: int
    dropped: int
    sources: Mapping[str, int]
    confidence: float
    median_ms: float
    p95_ms: float
    warnings: tuple[str, ...]
    gain: Gain | None = None


def _check_stamp(stamp_ns: int) -> None:
    """Reject a frame whose skeletons could not be recorded."""
    if stamp_ns < 0:
        raise InputError("its stamp is below 0: the sensor's clock was not set")


def process_recording(
    reader: Reader,
    output: Path | str,
    pipeline: Method,
    progress: Callable[[int], None] | None = None,
    note: Callable[[RunSummary], Mapping[str, str]] | None = None,
    *,
    markers: bool = False,
    second: SecondPass | None = None,
    tell: Callable[[Any], None] | None = None,
    is_ahead: bool = False,
) -> RunSummary:
    """Run the pipeline over a recording and write its skeletons.

    The same recording and a new pipeline of the same bank and settings give the same file, byte
    for byte.

    Parameters
    ----------
    reader : Reader
        The recording's frames.
    output : Path or str
        The recording of skeletons; it appears once it is complete.
    pipeline : Method
        The method; its temporal state is reset first.
    progress : callable, optional
        Called with the number of frames done; with a second pass each counts twice.
    note : callable, optional
        Returns the output's metadata record `NOTE`. With it the output is complete or not written
        at all; without, the frames done before Ctrl-C are left as ``NAME.partial.mcap``.
    markers : bool
        Whether to write standard markers as well, for viewers that do not support skeletons.
    second : SecondPass, optional
        Processes the recording backwards, and combines the results of both passes.
    tell : callable, optional
        Called with each frame's result, as soon as it is known; not for two passes.
    is_ahead : bool
        Whether the first stage of the next frame runs in a second thread meanwhile; the result is the same.
        Only for a `TwoStageMethod`.

    Raises
    ------
    InputError
        Where no frame of the recording can be used, or the output is the recording or cannot be written.
    PartlyWritten
        After Ctrl-C, where something was done.
    """
    refuse_inputs([output], [reader.path])
    pipeline.reset()
    sources: Counter[str] = Counter()
    confidences: list[float] = []
    empty = most = 0
    first = _Answers(reader, pipeline, progress, is_ahead=is_ahead)
    with SkeletonWriter(output, only_whole=note is not None) as writer:
        for result in first if second is None else second.run(first, first.count):
            if tell is not None:
                tell(result)
            followed, everybody = result.skeleton, result.skeletons
            writer.write_people(everybody, followed.stamp_ns, followed.frame_id)
            writer.write(followed)
            if markers:
                writer.write_markers(everybody, followed.stamp_ns, followed.frame_id)
            sources.update(s.source.name for s in everybody)
            confidences += [s.confidence for s in everybody]
            empty += not everybody
            most = max(most, len(everybody))
        times_ms = first.times_ms
        dropped = reader.dropped + first.refused.total()
        reasons = [f"{count} frames were dropped: {reason}" for reason, count in first.refused.items()]
        if first.refused and not times_ms:
            raise InputError(f"{reader.path}: " + "; ".join((*reader.warnings, *reasons)))
        summary = RunSummary(
            frames=len(times_ms) + dropped,
            answered=len(times_ms) - empty,
            empty=empty,
            most_people=most,
            dropped=dropped,
            sources=dict(sources),
            confidence=float(np.mean(confidences)) if confidences else float("nan"),
            median_ms=float(np.median(times_ms)) if times_ms else float("nan"),
            p95_ms=float(np.percentile(times_ms, 95)) if times_ms else float("nan"),
            warnings=(*reader.warnings, *(f"{reader.path}: {line}" for line in pipeline.warnings), *reasons),
            gain=second.gain if second else None,
        )
        if first.floor_moved or first.floor is not None:
            writer.write_metadata(FLOOR, _MOVED if first.floor is None else first.floor.to_metadata())
        if note is not None:
            writer.write_metadata(NOTE, note(summary))
    return summary


class Paced:
    """A recording's frames no sooner than their stamps say, as a sensor sends them.

    Parameters
    ----------
    reader : Reader
    """

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def __iter__(self) -> Iterator[Any]:
        """Yield the frames in their order; waits before those that are not due."""
        start_s: float | None = None
        for frame in self._reader:
            due_s, now_s = frame.stamp_ns * 1e-9, time.monotonic()
            if start_s is None or not 0.0 <= due_s - (now_s - start_s) <= _LONGEST_PAUSE_S:
                start_s = now_s - due_s  # the first frame; one that is late; a gap
            time.sleep(due_s - (now_s - start_s))
            yield frame

    @property
    def path(self) -> Path:
        """The recording's file or folder."""
        return self._reader.path

    @property
    def dropped(self) -> int:
        """Frames that could not be used."""
        return self._reader.dropped

    @property
    def warnings(self) -> Sequence[str]:
        """Problems, one line each."""
        return self._reader.warnings


def has_moved(record: Mapping[str, str] | None) -> bool:
    """Whether a recording's metadata record `FLOOR` says that the sensor moved."""
    return record == _MOVED


def _process(method: Callable[[Any], Any], frame: Any) -> Any:
    _check_stamp(frame.stamp_ns)
    return method(frame)


def _conclude(method: TwoStageMethod, perceived: Future[Any]) -> Any:
    return method.conclude(perceived.result())


class _Answers:
    """Results of the method for each usable frame, in order.

    Attributes
    ----------
    times_ms : list of float
        Processing time of each answered frame.
    refused : Counter
        Frames that the method refused, by reason.
    floor : Floor or None
        The floor, if the method found one and it never moved.
    floor_moved : bool
    """

    def __init__(
        self,
        reader: Reader,
        method: Method,
        progress: Callable[[int], None] | None,
        *,
        is_ahead: bool,
    ) -> None:
        self.times_ms: list[float] = []
        self.refused: Counter[str] = Counter()
        self.floor: Floor | None = None
        self.floor_moved = False
        self._newest: Floor | None = None
        self._changes = 0
        self._reader, self._method, self._progress = reader, method, progress
        self._is_ahead, self._counted = is_ahead, 0

    def __iter__(self) -> Iterator[Any]:
        for process in self._processed_ahead() if self._is_ahead else self._processed():
            start = time.perf_counter()
            try:
                result = process()
            except InputError as error:
                self.refused[str(error)] += 1
                continue
            self.times_ms.append((time.perf_counter() - start) * 1e3)
            self._look_at(getattr(result, "floor", None))
            yield result
            self._tell()

    def _processed(self) -> Iterator[Callable[[], Any]]:
        """Yield a function for each frame, which returns the result."""
        for frame in self._reader:
            yield partial(_process, self._method.process_frame, frame)

    def _processed_ahead(self) -> Iterator[Callable[[], Any]]:
        """Yield the same functions while the next frame's first stage runs beside them."""
        assert isinstance(self._method, TwoStageMethod), "only such a method is run ahead"
        with ThreadPoolExecutor(1, "depth_pose") as beside:
            waiting: Future[Any] | None = None
            for frame in self._reader:
                started = beside.submit(_process, self._method.perceive, frame)
                if waiting is not None:
                    yield partial(_conclude, self._method, waiting)
                waiting = started
            if waiting is not None:
                yield partial(_conclude, self._method, waiting)

    def _look_at(self, floor: Floor | None) -> None:
        """Keep the newest floor; none any more where the sensor has moved."""
        if floor is None or self.floor_moved:
            return
        if self._newest is not None and not floor.is_like(self._newest, _MOVES):
            self._changes += 1
        self._newest = floor
        self.floor_moved = self._changes > _MOST_CHANGES
        self.floor = None if self.floor_moved else floor

    def count(self) -> None:
        """Count a frame of the second pass."""
        self._counted += 1
        self._tell()

    def _tell(self) -> None:
        if self._progress:
            self._progress(len(self.times_ms) + self.refused.total() + self._reader.dropped + self._counted)
