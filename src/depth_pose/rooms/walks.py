"""People who walk, as two cameras see them at one time: what clocks are estimated from.

A camera's sighting is compared with where another camera sees the person at the same stamp, interpolated
between a frame before and one after. So neither frames that are missing nor messages that come late shift the
difference, as they would if the other camera's last frame were extrapolated. The velocity is the other
camera's central difference: its error is independent of that of the difference.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from depth_pose.rooms.sightings import RoomSighting

CORRELATED_S = 0.5
"""Correlation time (s) of the errors of sightings; set by hand."""

_HALF_NS = 150_000_000
"""Half the span (ns) of the central difference; set by hand."""

_GAP_NS = 500_000_000
"""Maximum distance (ns) of frames between which a person's place is interpolated; set by hand."""

_KEPT_NS = 2_000_000_000
"""Time (ns) for which sightings are kept: messages may come this late; set by hand."""


@dataclass(frozen=True, eq=False)
class WalkSample:
    """One person's places by two cameras at one time.

    Attributes
    ----------
    camera : int
    stamp_ns : int
        Of the camera's frame, in the room's clock.
    difference, velocity : (2,) float64
        Place by this camera minus that by the other one, metres; velocity by the other one, m/s; horizontal.
    weight_s : float
        Time for which the sample stands: since the last one, at most `CORRELATED_S`.
    """

    camera: int
    stamp_ns: int
    difference: NDArray[np.float64]
    velocity: NDArray[np.float64]
    weight_s: float


_History = deque[tuple[int, RoomSighting]]
"""Sightings of one person by one camera, with their stamps in the room's clock (ns), in order."""


class Walks:
    """Keeps the last seconds of everybody's ways, and compares the cameras."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._paths: dict[tuple[str, int], _History] = {}
        self._waiting: dict[tuple[str, int], _History] = {}
        self._last_ns: dict[tuple[str, int], int] = {}

    def forget(self, camera: int) -> None:
        """Forget a camera's sightings, whose clock or place is another now."""
        for kept in (self._paths, self._waiting, self._last_ns):
            for key in [key for key in kept if key[1] == camera]:
                del kept[key]

    def add(
        self, camera: int, stamp_ns: int, ids: Sequence[str], people: Sequence[RoomSighting]
    ) -> list[WalkSample]:
        """Add a frame, and return the comparisons that it makes possible.

        Parameters
        ----------
        camera : int
        stamp_ns : int
            In the room's clock; increasing for each camera.
        ids : sequence of str
            The people's ids in the room.
        people : sequence of RoomSighting
        """
        for room_id, sighting in zip(ids, people, strict=True):
            key = room_id, camera
            path = self._paths.setdefault(key, deque())
            if path and not (
                0 < stamp_ns - path[-1][0] <= _GAP_NS and path[-1][1].body_id == sighting.body_id
            ):
                path.clear()
            path.append((stamp_ns, sighting))
            self._waiting.setdefault(key, deque()).append((stamp_ns, sighting))
        self._forget_old(stamp_ns)
        found = [self._compare(*key, waiting) for key, waiting in self._waiting.items() if key[0] in ids]
        return [sample for samples in found for sample in samples]

    def _forget_old(self, stamp_ns: int) -> None:
        for kept in (self._paths, self._waiting):
            for key, path in list(kept.items()):
                while path and abs(stamp_ns - path[0][0]) > _KEPT_NS:
                    path.popleft()
                if not path:
                    del kept[key]
        self._last_ns = {k: ns for k, ns in self._last_ns.items() if abs(stamp_ns - ns) <= _KEPT_NS}

    def _compare(self, room_id: str, camera: int, waiting: _History) -> list[WalkSample]:
        """Compare the waiting sightings of a person that another camera has seen before and after."""
        others = [path for key, path in self._paths.items() if key[0] == room_id and key[1] != camera]
        samples = []
        for stamp_ns, sighting in list(waiting):
            if not any(path[-1][0] >= stamp_ns + _HALF_NS for path in others):
                break
            waiting.popleft()
            seen = [pair for path in others if (pair := _difference(path, stamp_ns, sighting)) is not None]
            if not seen:
                continue
            difference, velocity = min(seen, key=lambda pair: float(np.hypot(*pair[0])))
            since_ns = stamp_ns - self._last_ns.get((room_id, camera), 0)
            self._last_ns[room_id, camera] = stamp_ns
            weight_s = min(since_ns * 1e-9, CORRELATED_S)
            samples.append(WalkSample(camera, stamp_ns, difference, velocity, weight_s))
        return samples


def _difference(
    path: _History, stamp_ns: int, sighting: RoomSighting
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return difference and velocity (2,); None if the path does not reach to both sides of the stamp."""
    places = [_at(path, stamp_ns + span_ns) for span_ns in (-_HALF_NS, 0, _HALF_NS)]
    before, now, after = places
    if before is None or now is None or after is None:
        return None
    velocity = before.shift_to(after)[:2] / (2e-9 * _HALF_NS)
    return now.shift_to(sighting)[:2], velocity


def _at(path: _History, stamp_ns: int) -> RoomSighting | None:
    """Return a person's place at a stamp, interpolated; None outside the path."""
    for (a_ns, a), (b_ns, b) in pairwise(path):
        if a_ns <= stamp_ns <= b_ns:
            share = (stamp_ns - a_ns) / (b_ns - a_ns)
            return replace(
                a,
                joints=(1.0 - share) * a.joints + share * b.joints,
                joint_confidence=np.minimum(a.joint_confidence, b.joint_confidence),
                joint_states=np.maximum(a.joint_states, b.joint_states),
            )
    return None
