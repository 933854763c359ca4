"""Tracking: each person keeps one id from frame to frame.

Tracks and detections are paired so that the sum of their gains (`depth_pose.track.likeness`) is largest. The
gains depend on place given the motion, body size, pose, and the time for which the person was hidden. Hidden
people are remembered for `RETURN_NS` and keep their id if place and build agree when they return. A track
gets an id once it is likely enough to be a person (`depth_pose.track.person_odds`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from depth_pose.core.odds import logit
from depth_pose.core.rotations import length_of
from depth_pose.detect.segmentation import Detection
from depth_pose.track import likeness
from depth_pose.track.likeness import Size, Traits
from depth_pose.track.person_odds import PersonOdds, TrackEvidence
from depth_pose.track.state import MEMORY_NS, RETURN_NS

_MOST_SPEED_M_S = 3.0
"""Maximum velocity used to predict a track (m/s)."""

_VELOCITY_SHARE, _VELOCITY_S = 0.3, 0.04
"""Weight of a new velocity in a frame, and the length of that frame (s); swept."""


class TrackLimits(NamedTuple):
    """Person probabilities that decide about tracks.

    Attributes
    ----------
    start, keep : float
        Of detections that start a track, and that continue one.
    confirm : float
        Of a track, from which it has an id.
    """

    start: float = 0.2
    keep: float = 0.1
    confirm: float = 0.3


@dataclass(eq=False)
class _Track:
    """A track; its number is 0 until it is confirmed as a person."""

    traits: Traits
    seen_ns: int
    first: NDArray[np.float64]
    velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    number: int = 0
    detections: int = 0
    evidence: TrackEvidence = field(default_factory=TrackEvidence)
    size: Size | None = field(init=False)
    began_ns: int = field(init=False)

    def __post_init__(self) -> None:
        self.size, self.began_ns = self.traits.size, self.seen_ns

    def is_kept(self, stamp_ns: int) -> bool:
        """Check that the track is still remembered; unconfirmed tracks are forgotten sooner."""
        return stamp_ns - self.seen_ns <= (RETURN_NS if self.number else MEMORY_NS)

    def gain(self, seen: Traits, stamp_ns: int) -> float:
        """Compute the part of the gain (nats) from place, size and pose."""
        gap_s = (stamp_ns - self.seen_ns) * 1e-9
        density = likeness.place_density(self.traits.place, self.velocity, seen.place, gap_s)
        if density == 0.0:
            return -math.inf
        of_pose = likeness.pose_gain(self.traits, seen, gap_s)
        return math.log(density) + likeness.size_gain(self.size, seen.size) + of_pose

    def take_over(self, back: _Track) -> None:
        """Continue the track of a hidden person."""
        self.number = back.number
        self.detections += back.detections
        self.evidence = self.evidence.joined(back.evidence)
        if back.size is not None:
            self.size = back.size if self.size is None else back.size.merged(self.size, math.inf)

    def see(self, seen: Traits, detection: Detection, stamp_ns: int, is_still: bool) -> None:
        """Update the track with a detection, and whether the camera stands still."""
        self.detections += 1
        seconds = (stamp_ns - self.seen_ns) * 1e-9
        if not is_still:
            self.first = seen.place
        self.evidence = self.evidence.seen(
            logit(detection.probability),
            seconds,
            length_of(seen.place - self.first),
            length_of(seen.place),
            None if detection.measured is None else float(detection.measured.sigma[:, 0].mean()),
        )
        if seen.size is not None and self.detections > 1:
            self.size = seen.size if self.size is None else self.size.merged(seen.size, seconds)
        if seconds > 0.0:
            share = 1.0 - (1.0 - _VELOCITY_SHARE) ** (seconds / _VELOCITY_S)
            way = seen.place - self.traits.place
            self.velocity = self.velocity + share * (way / seconds - self.velocity)
            speed = length_of(self.velocity)
            self.velocity *= min(1.0, _MOST_SPEED_M_S / max(speed, 1e-6))
        self.traits, self.seen_ns = seen, stamp_ns


class PeopleTracks:
    """Assigns ids to detections, and keeps them over time.

    Parameters
    ----------
    limits : TrackLimits
    odds : PersonOdds, optional
        The packaged ones if not given.
    """

    def __init__(self, limits: TrackLimits = TrackLimits(), odds: PersonOdds | None = None) -> None:  # noqa: B008
        self._limits = limits
        self._odds = odds or PersonOdds.load()
        self._count = 0
        self.reset()

    def reset(self) -> None:
        """Forget all tracks; ids are not used again."""
        self._tracks: list[_Track] = []
        self._before_ns = self._now_ns = 0

    def restart(self) -> None:
        """Forget all tracks and ids, as if new."""
        self.reset()
        self._count = 0

    def assign(
        self, detections: Sequence[Detection], stamp_ns: int, is_still: bool = True
    ) -> tuple[str | None, ...]:
        """Assign ids to the detections of a frame; stamps increase between calls until `reset`.

        Parameters
        ----------
        detections : sequence of Detection
        stamp_ns : int
        is_still : bool
            Whether the camera stands still, so that places are those in the room.

        Returns
        -------
        tuple of str or None
            A body id for each; None for those not confirmed as a person.
        """
        self._tracks = [t for t in self._tracks if t.is_kept(stamp_ns)]
        self._before_ns, self._now_ns = self._now_ns, stamp_ns
        traits = [likeness.traits_of(s) for s in detections]
        parts = likeness.fragments(traits)
        track_of = self._pair(detections, traits, parts, stamp_ns)
        for k, detection in enumerate(detections):
            if k not in track_of and k not in parts and detection.probability >= self._limits.start:
                track_of[k] = _Track(traits[k], stamp_ns, detection.place)
                self._tracks.append(track_of[k])
        for k, track in track_of.items():
            track.see(traits[k], detections[k], stamp_ns, is_still)
        for k, track in track_of.items():
            self._believe(track, detections[k], stamp_ns)
        return tuple(_name(track_of[k]) if k in track_of else None for k in range(len(detections)))

    @property
    def evidence(self) -> dict[str, TrackEvidence]:
        """Evidence of all tracks that have an id."""
        return {name: t.evidence for t in self._tracks if (name := _name(t)) is not None}

    def probability(self, body_id: str) -> float:
        """Return the person probability of a track, from all detections; 0 without a track."""
        for track in self._tracks:
            if _name(track) == body_id:
                return self._odds.before_fit(track.evidence)
        return 0.0

    def _believe(self, track: _Track, detection: Detection, stamp_ns: int) -> None:
        """Assign a number to a confirmed track: that of a hidden person, or a new one."""
        if track.number > 0 or self._odds.before_fit(track.evidence) < self._limits.confirm:
            return
        hidden = [t for t in self._tracks if t.number > 0 and t.seen_ns < track.began_ns]
        gains = [self._gain(t, detection, track.traits, stamp_ns) for t in hidden]
        if gains and max(gains) > 0.0:
            back = hidden[int(np.argmax(gains))]
            self._tracks.remove(back)
            track.take_over(back)
        else:
            self._count += 1
            track.number = self._count

    def _gain(self, track: _Track, detection: Detection, seen: Traits, stamp_ns: int) -> float:
        """Compute the gain (nats) of pairing a detection with a track."""
        frame_s = (stamp_ns - self._before_ns) * 1e-9
        odds = likeness.seen_odds((stamp_ns - track.seen_ns) * 1e-9, frame_s, track.number > 0)
        new = likeness.new_density(detection.probability, frame_s)
        return odds - math.log(new) + track.gain(seen, stamp_ns)

    def _pair(
        self, detections: Sequence[Detection], traits: Sequence[Traits], parts: set[int], stamp_ns: int
    ) -> dict[int, _Track]:
        """Pair detections, by index, with tracks at the largest sum of gains; fragments revive no track."""
        gains = {
            (i, k): gain
            for i, track in enumerate(self._tracks)
            for k, detection in enumerate(detections)
            if detection.probability >= self._limits.keep
            and (k not in parts or track.seen_ns == self._before_ns)
            and (gain := self._gain(track, detection, traits[k], stamp_ns)) > 0.0
        }
        return {k: self._tracks[i] for i, k in best_pairs(gains, len(self._tracks), len(detections))}


def best_pairs(gains: dict[tuple[int, int], float], tracks: int, detections: int) -> list[tuple[int, int]]:
    """Choose disjoint pairs of (track, detection) with the largest sum of gains.

    Parameters
    ----------
    gains : dict of (int, int) to float
        Positive, of the pairs that may be chosen.
    tracks, detections : int
        Numbers of tracks and detections.
    """
    if len({i for i, _ in gains}) == len({k for _, k in gains}) == len(gains):  # the usual case
        return list(gains)
    # `scipy.optimize` has the same but takes .4 s to import; a track may stay alone at a gain of 0
    most = 1.0 + max(gains.values())
    costs = np.zeros((tracks, detections + tracks))
    costs[:, detections:] = np.diag(np.full(tracks, most))  # 0 is no edge
    for pair, gain in gains.items():
        costs[pair] = most - gain
    rows, columns = min_weight_full_bipartite_matching(csr_array(costs))
    return [(int(i), int(k)) for i, k in zip(rows, columns, strict=True) if k < detections]


def _name(track: _Track) -> str | None:
    return f"body_{track.number}" if track.number > 0 else None
