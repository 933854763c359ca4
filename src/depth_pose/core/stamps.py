"""Decide when to drop the memory of earlier frames."""

from __future__ import annotations

from depth_pose.core.config import MAX_STAMP_GAP_NS


class StampGuard:
    """Detector of stamps that jump back, or ahead by more than half a second."""

    def __init__(self) -> None:
        self._last_ns: int | None = None

    def is_break(self, stamp_ns: int) -> bool:
        """Record a frame's stamp; return whether memory of earlier frames must be dropped."""
        last, self._last_ns = self._last_ns, stamp_ns
        return last is not None and not 0 <= stamp_ns - last <= MAX_STAMP_GAP_NS
