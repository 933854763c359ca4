"""Who is who from frame to frame: everybody keeps one id while they are followed.

Each person followed is expected where their motion leads; what a frame shows is assigned to them
at the least sum of distances. People do not jump: what is too far off is somebody else. Somebody
hidden is waited for, and is who comes back there if the build agrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from depth_pose.core.stamps import StampGuard
from depth_pose.detect.segmentation import Sighting
from depth_pose.track.memory import MEMORY_NS

_STILL_M = 0.45
"""How far a person's middle may seem to move by what is hidden of them, or not."""

_SPEED_M_S = 3.0
"""How fast people move at most; running indoors."""

_MOST_M = 1.0
"""Nobody is looked for farther off than this from where they are expected, metres."""

_VELOCITY_SHARE = 0.3
"""Share of a new velocity that is taken over a frame of `_VELOCITY_S`; set by hand."""

_VELOCITY_S = 0.04
"""The frame that `_VELOCITY_SHARE` is told for, seconds."""
_DOUBT = 0.5
"""Sightings' worth of doubt that everybody begins with; by hand: a thing that the finder takes for a person
in one frame, at .9, comes out below .6."""

_MOVED_M = 0.25
"""Who has come so far from where they were first seen is no thing, metres: a coat's place is told to 5 cm."""

_COASTING_S = 0.7
"""Time after which a hidden person is no longer expected to walk on, seconds."""


_AWAY_S = 0.3
"""Who was not seen for longer than this has to agree in size with whom they are taken for, seconds."""

_UNLIKE = 0.25
"""Difference of the logarithms of two sizes that are not one person's: a child of eight and an adult differ
by .3 and more, a person's own proposals by .15 as they sit down. Set by hand."""

_LENGTH_SHARE = 0.1
"""Share of a sighting in the size of somebody who is followed."""


@dataclass
class _Track:
    """Somebody who is followed; their number is 0 until they are believed to be a person."""

    first: NDArray[np.float64]
    seen_ns: int
    place: NDArray[np.float64]
    velocity: NDArray[np.float64]
    number: int = 0
    sightings: int = 0
    evidence: float = 0.0
    length: float = 0.0

    @property
    def probability(self) -> float:
        """That this is a person, after all sightings."""
        return self.evidence / (self.sightings + _DOUBT)

    def expected(self, stamp_ns: int) -> NDArray[np.float64]:
        """Where the person should be now; who is hidden for long slows down."""
        seconds = (stamp_ns - self.seen_ns) * 1e-9
        return self.place + self.velocity * min(seconds, _COASTING_S)

    def may_be(self, sighting: Sighting, stamp_ns: int) -> bool:
        """Tell whether the size allows that this is the person again, after they were away."""
        known = self.length > 0.0 and sighting.length > 0.0
        if not known or stamp_ns - self.seen_ns <= _AWAY_S * 1e9:
            return True
        return abs(float(np.log(sighting.length / self.length))) < _UNLIKE

    def see(self, sighting: Sighting, stamp_ns: int) -> None:
        """Take a new place over, and what it says of being a person."""
        place = sighting.place
        self.sightings += 1
        self.evidence += sighting.probability
        share = _LENGTH_SHARE if self.length > 0.0 else 1.0
        if sighting.length > 0.0:
            self.length += share * (sighting.length - self.length)
        seconds = (stamp_ns - self.seen_ns) * 1e-9
        if seconds > 0.0:
            share = 1.0 - (1.0 - _VELOCITY_SHARE) ** (seconds / _VELOCITY_S)
            self.velocity = self.velocity + share * ((place - self.place) / seconds - self.velocity)
            speed = float(np.linalg.norm(self.velocity))
            self.velocity *= min(1.0, _SPEED_M_S / max(speed, 1e-6))
        self.place, self.seen_ns = place, stamp_ns


class PeopleTracks:
    """Names people, and keeps the names.

    Parameters
    ----------
    start, sure, keep : float
        Least probability with which somebody is followed from now on; is believed in at once, while others
        must move first; and is still believed in.
    """

    def __init__(self, start: float, sure: float, keep: float) -> None:
        self._start, self._sure, self._keep = start, sure, keep
        self._guard = StampGuard()
        self._count = 0
        self.reset()

    def reset(self) -> None:
        """Forget everybody; names are not given twice."""
        self._tracks: list[_Track] = []

    def restart(self) -> None:
        """Forget everybody and the names given, as if new."""
        self.reset()
        self._count = 0

    def assign(self, sightings: Sequence[Sighting], stamp_ns: int) -> tuple[str | None, ...]:
        """Name what a frame shows.

        Parameters
        ----------
        sightings : sequence of Sighting
        stamp_ns : int

        Returns
        -------
        tuple of str or None
            A body id for each; None for what is not believed to be a person.
        """
        if self._guard.is_break(stamp_ns):
            self.reset()
        self._tracks = [t for t in self._tracks if stamp_ns - t.seen_ns <= MEMORY_NS]
        names: list[str | None] = [None] * len(sightings)
        seen: set[int] = set()
        for track, k in self._pair(sightings, stamp_ns):
            seen.add(k)
            names[k] = self._see(track, sightings[k], stamp_ns)
        for k, sighting in enumerate(sightings):
            if k not in seen and sighting.probability >= self._start:
                track = _Track(sighting.place, stamp_ns, sighting.place, np.zeros(3))
                self._tracks.append(track)
                names[k] = self._see(track, sighting, stamp_ns)
        return tuple(names)

    def _see(self, track: _Track, sighting: Sighting, stamp_ns: int) -> str | None:
        """Follow somebody on; gives their name if they are believed to be a person."""
        track.see(sighting, stamp_ns)
        has_moved = sighting.is_news or np.hypot(*(track.place - track.first)[[0, 2]]) >= _MOVED_M
        is_likely = sighting.probability >= (self._start if has_moved else self._sure)
        if track.number == 0 and is_likely:
            self._count += 1
            track.number = self._count
        return _name(track) if track.number > 0 else None

    def probability(self, body_id: str) -> float:
        """Chance that somebody who is followed is a person, after all sightings; 0 for nobody."""
        return next((t.probability for t in self._tracks if _name(t) == body_id), 0.0)

    def _pair(self, sightings: Sequence[Sighting], stamp_ns: int) -> list[tuple[_Track, int]]:
        """Pair those who are followed with what is seen, at the least sum of distances."""
        if not self._tracks or not sightings:
            return []
        far = 1e3
        costs = np.full((len(self._tracks), len(sightings)), far)
        for i, track in enumerate(self._tracks):
            reach = min(_STILL_M + _SPEED_M_S * (stamp_ns - track.seen_ns) * 1e-9, _MOST_M)
            expected = track.expected(stamp_ns)
            for k, sighting in enumerate(sightings):
                # heights do not count: the middle of somebody whose legs are hidden lies higher
                gap = (sighting.place - expected)[[0, 2]]
                still = (sighting.place - track.place)[[0, 2]]
                distance = min(float(np.hypot(*gap)), float(np.hypot(*still)))
                is_near = distance <= reach and sighting.probability >= self._keep
                if is_near and track.may_be(sighting, stamp_ns):
                    costs[i, k] = distance
        if costs.size == 1:  # as in most frames
            return [(self._tracks[0], 0)] if costs[0, 0] < far else []
        # a cost of 0 would be no edge; `scipy.optimize` does the same and takes .4 s to import
        rows, columns = min_weight_full_bipartite_matching(csr_array(1.0 + costs))
        return [(self._tracks[i], int(k)) for i, k in zip(rows, columns, strict=True) if costs[i, k] < far]


def _name(track: _Track) -> str:
    return f"body_{track.number}"
