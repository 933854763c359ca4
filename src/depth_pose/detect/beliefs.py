"""What was surely a person a moment ago and has not moved since is one still.

The nets judge each image by itself. Somebody who lies still under a camera that sees them in an unusual way
is surely found in some frames and doubted in others, though nothing has changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.detect.segmentation import Sighting

_HALF_LIFE_S = 4.0
"""Time after which half of a belief is left, seconds. Set by hand."""
_LONGEST_S = 0.5
"""A belief that was not renewed for longer is forgotten, seconds: as all temporal state is."""
_OVERLAP, _MOVED_M = 0.6, 0.04
"""Share of the smaller mask that both have, and median change of depth there, metres, of what has not moved.
Set by hand."""


@dataclass(frozen=True)
class _Belief:
    """A sure sighting: its pixels, their depth, how sure, and when."""

    own: NDArray[np.bool_]
    depth: NDArray[np.float32]
    probability: float
    stamp_ns: int


class Beliefs:
    """Carries the probability of those who do not move from frame to frame.

    Parameters
    ----------
    sure : float
        Least probability of both looks that is carried.
    """

    def __init__(self, sure: float) -> None:
        self._sure = sure
        self.reset()

    def reset(self) -> None:
        """Forget everybody."""
        self._beliefs: list[_Belief] = []

    def renew(
        self,
        sightings: Sequence[Sighting],
        labels: NDArray[np.uint8],
        depth: NDArray[np.float32],
        stamp_ns: int,
    ) -> list[Sighting]:
        """Raise probabilities to those of the best earlier sighting, which decay with time.

        Parameters
        ----------
        sightings : sequence of Sighting
        labels : (h, w) uint8
            Whose each pixel is, by `Sighting.label`.
        depth : (h, w) float32
            Metres.
        stamp_ns : int
        """
        renewed, beliefs = [], []
        for sighting in sightings:
            own = (labels == sighting.label) & (depth > 0)
            carried = max((self._carried(b, own, depth, stamp_ns) for b in self._beliefs), default=0.0)
            probability = max(sighting.probability, carried)
            renewed.append(replace(sighting, probability=probability))
            if carried > 0.0 or sighting.probability >= self._sure:
                beliefs.append(_Belief(own, depth, probability, stamp_ns))
        self._beliefs = beliefs
        return renewed

    def _carried(
        self, belief: _Belief, own: NDArray[np.bool_], depth: NDArray[np.float32], stamp_ns: int
    ) -> float:
        """Return what is left of a belief for the pixels of a sighting; 0 for another, or one who moved."""
        past_s = (stamp_ns - belief.stamp_ns) * 1e-9
        if not 0 < past_s <= _LONGEST_S or belief.own.shape != own.shape:
            return 0.0
        both = belief.own & own
        count = np.count_nonzero(both)
        if count < max(_OVERLAP * min(np.count_nonzero(belief.own), np.count_nonzero(own)), 1):
            return 0.0
        if np.median(np.abs(belief.depth[both] - depth[both])) > _MOVED_M:
            return 0.0
        return float(belief.probability * 0.5 ** (past_s / _HALF_LIFE_S))
