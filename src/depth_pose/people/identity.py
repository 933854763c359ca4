"""Whether the person in view is still the same one: people do not jump aside or in depth."""

from __future__ import annotations

import numpy as np

from depth_pose.people.person import PersonView

_STILL_M = 0.45
"""How far a person's middle may seem to move by what is hidden of them, or not."""

_SPEED_M_S = 3.0
_MOST_M = 1.0
_MEMORY_NS = 2_000_000_000
"""Who comes into view at the same place within this time is taken for the same person."""


class PersonGuard:
    """Remembers where and when somebody was seen last."""

    def __init__(self) -> None:
        self._seen: tuple[int, float, float] | None = None

    def is_other(self, view: PersonView, stamp_ns: int) -> bool:
        """Say whether a frame shows another person than the last one noted, or the first.

        Heights do not count: the middle of somebody whose legs are hidden lies higher.
        """
        if self._seen is None or not 0 <= stamp_ns - self._seen[0] <= _MEMORY_NS:
            return True
        x, _, z = np.median(view.points, axis=0)
        allowed = min(_STILL_M + _SPEED_M_S * (stamp_ns - self._seen[0]) * 1e-9, _MOST_M)
        return bool(np.hypot(x - self._seen[1], z - self._seen[2]) > allowed)

    def note(self, view: PersonView, stamp_ns: int) -> None:
        """Remember who was seen."""
        x, _, z = np.median(view.points, axis=0)
        self._seen = (stamp_ns, float(x), float(z))
