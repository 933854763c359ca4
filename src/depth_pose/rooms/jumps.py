"""Measure how far all people of a camera jump at once, to tell which of two cameras was moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.rooms.sightings import RoomSighting

_GAP_S = 1.0
"""Time (s) for which a lost person is remembered; set by hand."""

_VELOCITY_S, _FASTEST_M_S = 0.1, 3.0
"""Time constant (s) of the velocity, and its maximum (m/s); set by hand."""


@dataclass(frozen=True, eq=False)
class _Seen:
    stamp_ns: int
    sighting: RoomSighting
    velocity: NDArray[np.float64]


class JumpMeter:
    """Compares each person's position with the one predicted from the camera's earlier frames."""

    def __init__(self) -> None:
        self._seen: dict[str, _Seen] = {}

    def measure(self, stamp_ns: int, people: Sequence[RoomSighting]) -> float:
        """Return the median jump (m, horizontal) of the people in the next frame; 0 where all are new.

        A person with a new id is compared with the nearest person who has disappeared.
        """
        self._seen = {i: s for i, s in self._seen.items() if 0 < stamp_ns - s.stamp_ns <= _GAP_S * 1e9}
        here = {person.body_id for person in people}
        gone = [s for i, s in self._seen.items() if i not in here]
        jumps = []
        for person in people:
            last = self._seen.get(person.body_id)
            candidates = [last] if last is not None else gone
            ways = [(self._way(c, person, stamp_ns), c) for c in candidates]
            velocity = np.zeros(3)
            if ways:
                jump, nearest = min(ways, key=lambda each: each[0])
                jumps.append(jump)
                velocity = self._velocity(nearest, person, stamp_ns)
            self._seen[person.body_id] = _Seen(stamp_ns, person, velocity)
        return float(np.median(jumps)) if jumps else 0.0

    @staticmethod
    def _way(last: _Seen, person: RoomSighting, stamp_ns: int) -> float:
        seconds = (stamp_ns - last.stamp_ns) * 1e-9
        way = last.sighting.shift_to(person) - last.velocity * seconds
        return float(np.hypot(way[0], way[1]))

    @staticmethod
    def _velocity(last: _Seen, person: RoomSighting, stamp_ns: int) -> NDArray[np.float64]:
        seconds = (stamp_ns - last.stamp_ns) * 1e-9
        measured = last.sighting.shift_to(person) / seconds
        velocity = last.velocity - np.expm1(-seconds / _VELOCITY_S) * (measured - last.velocity)
        return np.asarray(velocity * min(1.0, _FASTEST_M_S / max(float(np.linalg.norm(velocity)), 1e-6)))
