"""Rules for stamps: when to skip a frame, and when to drop the memory of earlier frames.

A frame that is a little late is skipped, and so is a single frame whose stamp does not follow those around it
(a zero, an hour ahead): `StampFilter` does so live, `depth_pose.io.frame_order` in recordings, where late
frames can also be sorted. `StampGuard` judges what passes: after a silence poses are forgotten, after a jump
everything.
"""

from __future__ import annotations

from enum import Enum

from depth_pose.core.config import MAX_STAMP_GAP_NS

MAX_REUSE_NS = 100_000_000
"""Maximum age (ns) of a measurement or candidate that is reused: at 5 frames a second, longer costs 1 to 3
points of PCK.10."""

LONGEST_SILENCE_NS = 2_000_000_000
"""Longest silence (ns) of a sensor after which people keep their ids; as long as somebody out of view."""

_LONGER = 3
"""A step is no jump if it is at most this many times the one before."""

OUT_OF_ORDER = "its stamp is before that of an earlier frame"
STRAY = "its stamp does not follow the frames around it"
"""Why a frame is skipped."""


class StampStep(Enum):
    """What a stamp means after the one before."""

    NEXT = "next"
    """The next frame."""
    SILENCE = "silence"
    """The sensor was silent for more than half a second: poses are forgotten, people are not."""
    BREAK = "break"
    """The clock jumped back, or far ahead: everything is forgotten."""


class StampGuard:
    """Judges the stamp of each frame after the one before."""

    def __init__(self) -> None:
        self._last_ns: int | None = None

    def step(self, stamp_ns: int) -> StampStep:
        """Record a frame's stamp; return what it means."""
        last, self._last_ns = self._last_ns, stamp_ns
        if last is None or 0 <= stamp_ns - last <= MAX_STAMP_GAP_NS:
            return StampStep.NEXT
        is_silence = 0 < stamp_ns - last <= LONGEST_SILENCE_NS
        return StampStep.SILENCE if is_silence else StampStep.BREAK

    def is_break(self, stamp_ns: int) -> bool:
        """Record a frame's stamp; return whether memory of earlier frames must be dropped."""
        return self.step(stamp_ns) is StampStep.BREAK


def is_late(stamp_ns: int, last_ns: int | None) -> bool:
    """Check whether a frame comes after a slightly newer one: by at most half a second."""
    return last_ns is not None and 0 < last_ns - stamp_ns <= MAX_STAMP_GAP_NS


def follows(stamp_ns: int, last_ns: int) -> bool:
    """Check whether a frame may come next after another: at most half a second later."""
    return 0 <= stamp_ns - last_ns <= MAX_STAMP_GAP_NS


class StampFilter:
    """Decides live which frames are skipped.

    A jump is believed when a second frame confirms it, so that a single wrong stamp ends nothing. Steps ahead
    are none if those before were as long: some sensors send a frame every ten seconds.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the frames so far."""
        self._last_ns: int | None = None
        self._suspect_ns: int | None = None
        self._step_ns = 0

    def why_skipped(self, stamp_ns: int) -> str:
        """Record a frame's stamp; return why it is skipped, or nothing."""
        last, suspect = self._last_ns, self._suspect_ns
        if is_late(stamp_ns, last):
            return OUT_OF_ORDER
        longest = max(LONGEST_SILENCE_NS, _LONGER * self._step_ns)
        if last is None or 0 <= stamp_ns - last <= longest:
            self._step_ns = 0 if last is None else stamp_ns - last
            self._last_ns, self._suspect_ns = stamp_ns, None
            return ""
        if suspect is not None and 0 <= stamp_ns - suspect < abs(stamp_ns - last):
            self._step_ns = stamp_ns - suspect
            self._last_ns, self._suspect_ns = stamp_ns, None
            return ""
        self._suspect_ns = stamp_ns
        return STRAY
