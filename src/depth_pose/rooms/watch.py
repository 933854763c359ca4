"""Decide which cameras take part: those that stopped, lag or were moved wait until they agree again."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from depth_pose.rooms.clock import ClockOffset

STOPPED_S = 1.0
"""Maximum silence (s) of a camera before it counts as stopped."""

LATE_S = 0.2
"""Maximum delay of a camera's messages (s) relative to the best camera's, before it counts as lagging."""

MOVED_M, MOVED_S = 0.25, 2.0
"""Distance (m) between a camera's people and the others' that means, for this long (s), that it was moved."""

BACK_S = 1.0
"""Time (s) for which an excluded camera must agree before it takes part again."""

CLOCK_S = 0.02
"""Clock offset (s) above which it is reported."""

_USUAL_DELAY_S = 0.1
"""Typical delay from a stamp to the skeleton's arrival (s); the clock of the camera nearest to it is
trusted."""

_DELAYS, _FEW_DELAYS = 30, 5
"""Number of messages over which a camera's minimum delay is taken, and the minimum number for a decision; set
by hand."""

_FASTER = 1.25
"""Factor by which another camera must be faster to set the pace; set by hand."""

_GAP_S = 0.5
"""Time (s) without a comparison after which a disagreement ends; set by hand."""

_JUMP_FADES_S = 3.0
"""Time constant (s) of the memory of a jump of all of a camera's people; set by hand."""


MOST_NEW, NEW_S = 30, 2.0
"""A camera that names more new people than this in this time (s) sees what is not there; set by hand."""


class CameraState(Enum):
    """How a camera takes part."""

    USED = "takes part"
    WAITING = "has sent nothing yet"
    STOPPED = "stopped"
    LAGS = "lags"
    MOVED = "was moved"
    GHOSTS = "sees people who are not there"
    OTHER_TIME = "has another time"


@dataclass(eq=False)
class WatchedCamera:
    """State of one camera.

    Attributes
    ----------
    name : str
    state : CameraState
    residual_m : float
        Median distance between its people and the others' views of them; NaN if no person is shared.
    clock : ClockOffset
    misfit : str
        How its place does not fit the other cameras'; empty if it does, as far as is known.
    """

    name: str
    state: CameraState = CameraState.WAITING
    residual_m: float = math.nan
    misfit: str = ""
    is_misfit_told: bool = False
    clock: ClockOffset = field(default_factory=ClockOffset)
    heard_s: float | None = None
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=_DELAYS))
    delays: deque[float] = field(default_factory=lambda: deque(maxlen=_DELAYS))
    compared_ns: int = 0
    apart_ns: int | None = None
    agrees_s: float | None = None
    timely_s: float | None = None
    jump_m: float = 0.0
    ids: frozenset[str] = frozenset()
    new_s: deque[float] = field(default_factory=lambda: deque(maxlen=MOST_NEW + 1))

    @property
    def delay_s(self) -> float:
        """Minimum time from a stamp to its arrival, seconds; NaN before the first message."""
        return min(self.delays, default=math.nan)

    @property
    def rate_hz(self) -> float:
        """Messages a second."""
        span = self.arrivals[-1] - self.arrivals[0] if len(self.arrivals) > 1 else 0.0
        return (len(self.arrivals) - 1) / span if span > 0.0 else 0.0


class CameraWatch:
    """Watches the cameras of a room.

    Parameters
    ----------
    names : sequence of str
        Names of the cameras.

    Attributes
    ----------
    cameras : tuple of WatchedCamera
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.cameras = tuple(WatchedCamera(name) for name in names)
        self._news: list[str] = []

    def fastest(self, before: int | None = None) -> int | None:
        """Return the camera with the most messages a second among those that take part.

        Parameters
        ----------
        before : int, optional
            The result of the last call, which is kept unless another camera is clearly faster.
        """
        used = [c for c in range(len(self.cameras)) if self.is_used(c)]
        if not used:
            return None
        first = max(used, key=lambda c: self.cameras[c].rate_hz)
        rate_hz = self.cameras[first].rate_hz
        return before if before in used and rate_hz < _FASTER * self.cameras[before].rate_hz else first

    def is_used(self, camera: int) -> bool:
        """Whether a camera takes part."""
        return self.cameras[camera].state == CameraState.USED

    def mark_misfits(self, lines: Mapping[int, str]) -> None:
        """Record how cameras do not fit (`depth_pose.rooms.fit_check`); tell it the second time."""
        for camera, of in enumerate(self.cameras):
            before, of.misfit = of.misfit, lines.get(camera, "")
            if before and of.misfit and not of.is_misfit_told:
                of.is_misfit_told = True
                if of.misfit not in self._news:  # one that names two cameras
                    self._news.append(of.misfit)

    def news(self) -> list[str]:
        """Return the changes since the last call, one line each."""
        news, self._news = self._news, []
        return news

    def tell(self, line: str) -> None:
        """Add a line to the news."""
        self._news.append(line)

    def hear(self, camera: int, stamp_ns: int, now_s: float) -> None:
        """Record a message.

        Parameters
        ----------
        camera : int
        stamp_ns : int
            Stamp of the message, uncorrected.
        now_s : float
            Time of the arrival, seconds, from which delays are computed if it is in the stamps' clock.
        """
        of = self.cameras[camera]
        if of.heard_s is None or not 0.0 <= now_s - of.heard_s <= STOPPED_S:
            of.delays.clear()
            of.arrivals.clear()
            of.agrees_s, of.timely_s = None, now_s
        of.heard_s = now_s
        of.arrivals.append(now_s)
        of.delays.append(now_s - stamp_ns * 1e-9)
        if of.state == CameraState.WAITING:
            of.state = CameraState.USED

    def count_people(self, camera: int, ids: Collection[str], now_s: float) -> bool:
        """Record who a camera sees; return whether it is left out, because it names ever new people."""
        of = self.cameras[camera]
        of.new_s.extend([now_s] * self._new_people(of, ids))
        of.ids = frozenset(ids)
        if self._is_haunted(of, now_s):
            of.timely_s = of.agrees_s = None
            self._leave_out(of, CameraState.GHOSTS, f"names more than {MOST_NEW} new people in {NEW_S:.0f} s")
            return True
        return False

    def is_haunted(self, camera: int, ids: Collection[str], now_s: float) -> bool:
        """Check whether a camera that names these people would be left out, before they are read."""
        of = self.cameras[camera]
        new = self._new_people(of, ids)
        return new > MOST_NEW or (of.state == CameraState.GHOSTS and (new > 0 or self._is_haunted(of, now_s)))

    @staticmethod
    def _new_people(of: WatchedCamera, ids: Collection[str]) -> int:
        return min(len(set(ids) - of.ids), MOST_NEW + 1)

    @staticmethod
    def _is_haunted(of: WatchedCamera, now_s: float) -> bool:
        """Whether a camera names more new people than there can be."""
        return len(of.new_s) > MOST_NEW and 0.0 <= now_s - of.new_s[0] <= NEW_S

    def jump(self, camera: int) -> None:
        """Record that a camera's clock jumped: its delays are judged anew."""
        self.cameras[camera].delays.clear()

    def reject(self, camera: int, apart_s: float, other: int) -> None:
        """Leave a camera out whose stamps are far from those of another."""
        of = self.cameras[camera]
        of.timely_s = of.agrees_s = None
        when = "ahead of" if apart_s > 0 else "behind"
        self._leave_out(
            of,
            CameraState.OTHER_TIME,
            f"has another time: its stamps are {abs(apart_s):.1f} s {when} those of "
            f"{self.cameras[other].name}; synchronise the clocks (chrony, PTP)",
        )

    def compare(
        self, camera: int, stamp_ns: int, now_s: float, apart_m: Sequence[float], jump: float = 0.0
    ) -> None:
        """Record the distances between a camera's people and the others' views of them.

        Parameters
        ----------
        camera : int
        stamp_ns : int
            Of its frame.
        now_s : float
            As for `hear`.
        apart_m : sequence of float
            Of the shared people, metres; may be empty.
        jump : float
            Median jump (m) of all its people in this frame.
        """
        of = self.cameras[camera]
        passed_s = max(stamp_ns - of.compared_ns, 0) * 1e-9 if of.compared_ns else 0.0
        of.jump_m = max(jump, of.jump_m * math.exp(-passed_s / _JUMP_FADES_S))
        if not apart_m:
            if passed_s > _GAP_S:
                of.apart_ns, of.agrees_s, of.residual_m = None, None, math.nan
            return
        of.compared_ns = stamp_ns
        of.residual_m = float(np.median(apart_m))
        agrees = of.residual_m <= MOVED_M
        if agrees:
            of.apart_ns = None
        elif of.apart_ns is None or passed_s > _GAP_S:
            of.apart_ns = stamp_ns
        if not agrees:
            of.agrees_s = None
        elif of.agrees_s is None:
            of.agrees_s = now_s

    def check(self, now_s: float) -> list[int]:
        """Update all states; return the cameras that were just excluded."""
        left_out = [c for c in range(len(self.cameras)) if self._check_messages(c, now_s)]
        apart_s = {
            c: (of.compared_ns - of.apart_ns) * 1e-9
            for c, of in enumerate(self.cameras)
            if of.state == CameraState.USED and of.apart_ns is not None
        }
        if max(apart_s.values(), default=0.0) >= MOVED_S:
            # two disagreeing cameras reach the limit within a frame: the one whose people jumped was moved,
            # in doubt the later one
            apart = [c for c, seconds in apart_s.items() if seconds > MOVED_S - _GAP_S]
            moved = max(apart, key=lambda c: (round(self.cameras[c].jump_m, 2), c))
            of = self.cameras[moved]
            self._leave_out(
                of,
                CameraState.MOVED,
                f"was moved: it sees people {of.residual_m:.2f} m from where others see them; "
                "put it back, or calibrate again",
            )
            left_out.append(moved)
            for other in self.cameras:
                other.apart_ns = None
        return left_out

    def _check_messages(self, camera: int, now_s: float) -> bool:
        """Return whether the camera was just excluded because its messages stopped or lagged."""
        of = self.cameras[camera]
        if of.state == CameraState.WAITING or of.heard_s is None:
            return False
        silent_s, late_s, before = now_s - of.heard_s, self._late_s(camera), of.state
        if silent_s > STOPPED_S:
            self._leave_out(of, CameraState.STOPPED, f"stopped: nothing came for {silent_s:.1f} s")
        elif of.state != CameraState.OTHER_TIME and abs(late_s) > LATE_S:
            of.timely_s = None
            when = "later" if late_s > 0 else "earlier"
            self._leave_out(
                of,
                CameraState.LAGS,
                f"lags: its messages come {abs(late_s):.2f} s {when} after their stamps than the others'; "
                "its computer is busy, or its clock is wrong",
            )
        elif before != CameraState.USED and not self._is_haunted(of, now_s):
            self._take_back(of, now_s)
        return before == CameraState.USED != of.state

    def _late_s(self, camera: int) -> float:
        """Return the delay of a camera's messages relative to the best camera's (s)."""
        judged = [of for of in self.cameras if len(of.delays) >= _FEW_DELAYS]
        delays = [of.delay_s for of in judged if of.state != CameraState.STOPPED]
        if not delays or self.cameras[camera] not in judged:
            return 0.0
        return self.cameras[camera].delay_s - min(delays, key=lambda d: abs(d - _USUAL_DELAY_S))

    def _leave_out(self, of: WatchedCamera, state: CameraState, why: str) -> None:
        if of.state != state:
            of.state, of.agrees_s, of.apart_ns = state, None, None
            self._news.append(f"{of.name} {why}. It is left out")

    def _take_back(self, of: WatchedCamera, now_s: float) -> None:
        """Include a camera again once it agrees, or is punctual and disagrees with nobody, for a while."""
        if of.timely_s is None:
            of.timely_s = now_s
        since_s: float | None = of.timely_s
        if of.state == CameraState.MOVED or not math.isnan(of.residual_m):
            since_s = of.agrees_s
        if since_s is not None and now_s - since_s >= BACK_S:
            of.state, of.jump_m, of.is_misfit_told = CameraState.USED, 0.0, False
            self._news.append(f"{of.name} takes part again")
