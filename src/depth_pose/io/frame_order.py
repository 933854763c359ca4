"""Put the frames of a recording in the order of their stamps; see `depth_pose.core.stamps`."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from statistics import median

from depth_pose.core.frame import DepthFrame
from depth_pose.core.stamps import OUT_OF_ORDER, STRAY, follows, is_late

_AHEAD = 2
"""Number of frames read ahead: later ones than that are skipped, not sorted; set by hand."""

_LEAST_STEP = 0.6
"""Minimum distance of a sorted frame's stamp from its neighbours, as a share of the frame period: a nearer
stamp is wrong. Set by hand."""

_FAR_NS = 60_000_000_000
"""A first frame this far (ns) from the next ones is skipped; set by hand."""

_PERIODS = 5
"""Number of last frames whose median period is used."""


class FrameOrder:
    """Sorts frames that are up to two places late, and skips later ones and single wrong stamps.

    If the stamps at the beginning stand still (all zero, say), the recording's log times are used.

    Attributes
    ----------
    skipped : Counter of str
        Number of skipped frames, by reason.
    sorted : int
        Number of frames moved before an earlier one.
    has_log_times : bool
        Whether log times were used.
    """

    def __init__(self) -> None:
        self.skipped: Counter[str] = Counter()
        self.sorted = 0
        self.has_log_times = False
        self._periods: deque[int] = deque(maxlen=_PERIODS)

    @property
    def warnings(self) -> list[str]:
        """Return what was changed, one line each."""
        lines = []
        if self.has_log_times:
            lines.append("the stamps stand still: the times at which the frames were recorded are used")
        if self.sorted:
            frames = "1 frame was" if self.sorted == 1 else f"{self.sorted} frames were"
            lines.append(f"{frames} recorded after a newer one, and sorted")
        return lines

    def __call__(self, frames: Iterable[tuple[int, DepthFrame]]) -> Iterator[DepthFrame]:
        """Yield frames, given with their log times (ns), in order."""
        ahead: deque[tuple[int, DepthFrame]] = deque()
        last: int | None = None
        for log_time_ns, frame in frames:
            ahead.append((log_time_ns, frame))
            if len(ahead) <= _AHEAD:
                continue
            if last is None:
                self.has_log_times = _stand_still(ahead)
            for chosen in self._next(ahead, last):
                last = self._note(chosen.stamp_ns, last)
                yield chosen
        if last is None:
            self.has_log_times = _stand_still(ahead)
        while ahead:
            for chosen in self._next(ahead, last):
                last = self._note(chosen.stamp_ns, last)
                yield chosen

    def _note(self, stamp_ns: int, last: int | None) -> int:
        """Record the period before a frame; return the frame's stamp."""
        if last is not None and stamp_ns > last:
            self._periods.append(stamp_ns - last)
        return stamp_ns

    def _next(self, ahead: deque[tuple[int, DepthFrame]], last: int | None) -> Iterator[DepthFrame]:
        """Take the next frame from those ahead, or skip the first."""
        if self.has_log_times:
            log_time_ns, frame = ahead.popleft()
            yield replace(frame, stamp_ns=log_time_ns)
            return
        first, *others = (frame.stamp_ns for _, frame in ahead)
        if is_late(first, last) and not _is_set_back(first, others, last):
            self.skipped[OUT_OF_ORDER] += 1
            ahead.popleft()
        elif _is_stray(first, others, last):
            self.skipped[STRAY] += 1
            ahead.popleft()
        else:
            near = [
                first,
                *(s for s in others if not is_late(first, last) and self._fits_before(s, first, last)),
            ]
            index = [frame.stamp_ns for _, frame in ahead].index(min(near))
            self.sorted += index > 0
            yield ahead[index][1]
            del ahead[index]

    def _fits_before(self, stamp_ns: int, first: int, last: int | None) -> bool:
        """Check whether a frame belongs into the gap between the last one and the first ahead."""
        if not is_late(stamp_ns, first) or last is None:
            return is_late(stamp_ns, first)
        least = _LEAST_STEP * median(self._periods) if self._periods else 0
        return min(stamp_ns - last, first - stamp_ns) >= least


def _is_set_back(first: int, others: list[int], last: int | None) -> bool:
    """Check whether all frames ahead are late, in order: the clock was set back."""
    stamps = [first, *others]
    return len(stamps) > _AHEAD and all(is_late(s, last) for s in stamps) and stamps == sorted(set(stamps))


def _is_stray(first: int, others: list[int], last: int | None) -> bool:
    """Check whether a frame has nothing to do with the last and the next frames, which follow each other."""
    if last is None:  # the beginning: the next two agree, and not with the first
        return (
            len(others) == _AHEAD and follows(max(others), min(others)) and abs(first - min(others)) > _FAR_NS
        )
    return not follows(first, last) and any(follows(stamp, last) for stamp in others)


def _stand_still(ahead: deque[tuple[int, DepthFrame]]) -> bool:
    """Check whether the stamps are equal and the log times are not."""
    times = [log_time_ns for log_time_ns, _ in ahead]
    return (
        len(ahead) > 1
        and len({frame.stamp_ns for _, frame in ahead}) == 1
        and all(a < b for a, b in pairwise(times))
    )
