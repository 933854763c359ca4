"""The times of several cameras: which frames are skipped, and which camera has another time than the others.

A camera's jump must be confirmed by a second frame (`depth_pose.core.stamps`). Where two cameras then differ
by more than `APART_S`, the clock whose stamps are near the time of arrival is right; where neither or both
are, the one whose time began earlier. The least delay of a few messages counts, since a busy machine is no
clock. A camera that another one agrees with is never wrong: one camera whose clock jumps is left out, and
where all begin again, as in a replay, the room does, too.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from depth_pose.core.stamps import StampFilter, follows

APART_S = 1.0
"""Maximum difference (s) of the times of two cameras; smaller ones are estimated from people who walk."""

_HEARD_S = 2.0
"""A camera that was not heard for this long (s) says nothing about time; set by hand."""

_DELAYS = 8
"""Number of messages of which the least delay counts; set by hand."""


@dataclass(eq=False)
class _Timeline:
    order: StampFilter = field(default_factory=StampFilter)
    stamp_ns: int | None = None
    heard_s: float = 0.0
    since_s: float = 0.0
    delays_s: deque[float] = field(default_factory=lambda: deque(maxlen=_DELAYS))

    @property
    def delay_s(self) -> float:
        """Least time from a stamp to the arrival (s)."""
        return min(self.delays_s)

    @property
    def rank(self) -> tuple[bool, float]:
        """The smaller, the more its time is to be believed."""
        return abs(self.delay_s) > APART_S, self.since_s


@dataclass(frozen=True)
class Judgement:
    """What a frame's stamp means.

    Attributes
    ----------
    skipped : str
        Why the frame is skipped; empty if it is not.
    has_jumped : bool
        Whether the camera's clock jumped.
    apart_s : float
        Difference (s) from another camera's time; 0 where it fits.
    other : int
        That camera.
    """

    skipped: str = ""
    has_jumped: bool = False
    apart_s: float = 0.0
    other: int = -1


class Timelines:
    """Watches the stamps of several cameras.

    Parameters
    ----------
    cameras : int
    """

    def __init__(self, cameras: int) -> None:
        self._lines = [_Timeline() for _ in range(cameras)]

    def judge(self, camera: int, stamp_ns: int, now_s: float) -> Judgement:
        """Judge a frame.

        Parameters
        ----------
        camera : int
        stamp_ns : int
            In the room's clock, as far as it is known.
        now_s : float
            Time of the arrival, seconds.
        """
        line = self._lines[camera]
        if skipped := line.order.why_skipped(stamp_ns):
            return Judgement(skipped)
        before = line.stamp_ns
        has_jumped = before is not None and not follows(stamp_ns, before)
        is_new = has_jumped or not 0.0 <= now_s - line.heard_s <= _HEARD_S
        line.stamp_ns, line.heard_s = stamp_ns, now_s
        if before is None or is_new:
            line.since_s = now_s
        if before is not None and stamp_ns < before:
            line.delays_s.clear()
        line.delays_s.append(now_s - stamp_ns * 1e-9)
        apart = self._apart(camera, now_s)
        if apart and min(map(abs, apart.values())) > APART_S:
            right = {c: s for c, s in apart.items() if self._lines[c].rank < line.rank}
            if right:
                other = min(right, key=lambda c: abs(right[c]))
                return Judgement(has_jumped=has_jumped, apart_s=right[other], other=other)
        return Judgement(has_jumped=has_jumped)

    def _apart(self, camera: int, now_s: float) -> dict[int, float]:
        """Return how far a camera's stamps are ahead of each other camera's that is heard (s)."""
        own = self._lines[camera]
        return {
            c: other.delay_s - own.delay_s
            for c, other in enumerate(self._lines)
            if c != camera and other.stamp_ns is not None and 0.0 <= now_s - other.heard_s <= _HEARD_S
        }
