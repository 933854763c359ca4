"""Decide when to drop the memory of earlier frames."""

from __future__ import annotations

from depth_pose.core.config import MAX_STAMP_GAP_NS

MAX_REUSE_NS = 100_000_000
"""Maximum age (ns) of a measurement or candidate that is reused: at 5 frames a second, longer costs 1 to 3
points of PCK.10."""


class StampGuard:
    """Detector of stamps that jump back, or ahead by more than half a second."""

    def __init__(self) -> None:
        self._last_ns: int | None = None

    def is_break(self, stamp_ns: int) -> bool:
        """Record a frame's stamp; return whether memory of earlier frames must be dropped."""
        last, self._last_ns = self._last_ns, stamp_ns
        return last is not None and not 0 <= stamp_ns - last <= MAX_STAMP_GAP_NS
