"""Memory of confident detections: a detected person who has not moved is still a person.

The nets judge each image by itself. A person who lies still, in an unusual view, is found with certainty in
some frames and doubted in others, though nothing has changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.medians import median_of
from depth_pose.detect.segmentation import Detection

_HALF_LIFE_S = 4.0
"""Half-life of a belief, seconds. Set by hand."""
_LONGEST_S = 0.5
"""A belief not renewed for this long (s) is forgotten, as all temporal state is."""
_OVERLAP, _MOVED_M = 0.6, 0.04
"""Least overlap, as a share of the smaller mask, and largest median change of depth there (m), of a person
who has not moved. Set by hand."""


@dataclass(frozen=True)
class _Belief:
    """A confident detection: its pixels, their depth, its probability and its stamp."""

    own: NDArray[np.bool_]
    depth: NDArray[np.float32]
    probability: float
    stamp_ns: int


class DetectionPersistence:
    """Carries the probability of people who do not move from frame to frame.

    Parameters
    ----------
    sure : float
        Least probability that is carried.
    """

    def __init__(self, sure: float) -> None:
        self._sure = sure
        self.reset()

    def reset(self) -> None:
        """Forget all people."""
        self._beliefs: list[_Belief] = []

    def renew(
        self,
        detections: Sequence[Detection],
        labels: NDArray[np.uint8],
        depth: NDArray[np.float32],
        stamp_ns: int,
    ) -> list[Detection]:
        """Raise probabilities to those of the best earlier detection, which decay with time.

        Parameters
        ----------
        detections : sequence of Detection
        labels : (h, w) uint8
            Person at each pixel, by `Detection.label`.
        depth : (h, w) float32
            Metres.
        stamp_ns : int
        """
        renewed, beliefs = [], []
        for detection in detections:
            own = (labels == detection.label) & (depth > 0)
            carried = max((self._carried(b, own, depth, stamp_ns) for b in self._beliefs), default=0.0)
            probability = max(detection.probability, carried)
            renewed.append(replace(detection, probability=probability))
            if carried > 0.0 or detection.probability >= self._sure:
                beliefs.append(_Belief(own, depth, probability, stamp_ns))
        self._beliefs = beliefs
        return renewed

    def _carried(
        self, belief: _Belief, own: NDArray[np.bool_], depth: NDArray[np.float32], stamp_ns: int
    ) -> float:
        """Return the decayed belief for the pixels of a detection; 0 for another person, or one who moved."""
        past_s = (stamp_ns - belief.stamp_ns) * 1e-9
        if not 0 < past_s <= _LONGEST_S or belief.own.shape != own.shape:
            return 0.0
        both = belief.own & own
        if both.sum() < max(_OVERLAP * min(belief.own.sum(), own.sum()), 1):
            return 0.0
        if median_of(np.abs(belief.depth[both] - depth[both])) > _MOVED_M:
            return 0.0
        return float(belief.probability * 0.5 ** (past_s / _HALF_LIFE_S))
