"""Clustering of the people finder's torso votes.

Votes for one torso concentrate, so people are separated by place, not by connectivity (Hough voting as in
Leibe et al. 2008, from every pixel as in Girshick et al. 2011).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.detect import _measure_kernels as measuring
from depth_pose.detect import _vote_kernels as kernels
from depth_pose.detect._finder_kernels import NetImage
from depth_pose.detect.turned import MOST_PIXELS

_LEAST_LOGIT = -0.62
"""Least logit of a voting pixel, a probability of .35."""

_RADIUS_M = 0.3
"""Radius of a cluster of votes (m); two people side by side are at least .45 m apart."""

_REACH_M = 0.5
"""Maximum distance (m) of a vote from its torso."""

_MOST_VOTES = 1000
"""Approximate number of votes used to find the torsos; all are assigned afterwards."""

_LEAST_AREA_M2 = 0.02
"""Least weight of the votes of a torso (m^2 of surface). Half: 3 mm better and .001 fewer
within 10 cm in rooms; double: the same."""
_MOST_PEOPLE = 24
"""Maximum number of torsos in a frame. Half and double answer the same in rooms."""


@dataclass(frozen=True)
class Clusters:
    """Clusters of votes around torsos, before verification.

    Attributes
    ----------
    labels : (H, W) uint8
        From 1; 0: background.
    torsos : (P, 3) float64
    measures : (P, MEASURES) float64
        Input of the verifier.
    neighbour : (P,) int64
        The nearest larger cluster, -1 for none near.
    """

    labels: NDArray[np.uint8]
    torsos: NDArray[np.float64]
    measures: NDArray[np.float64]
    neighbour: NDArray[np.int64]


class VoteGatherer:
    """Clusters torso votes; keeps only its work space from frame to frame."""

    def __init__(self) -> None:
        self._density = np.zeros(int(np.prod(kernels.CELLS)))
        self._owner = np.zeros(MOST_PIXELS, np.int64)
        self._votes = kernels.TorsoVotes(
            flat=np.zeros(MOST_PIXELS, np.int64),
            points=np.zeros((MOST_PIXELS, 3)),
            weights=np.zeros(MOST_PIXELS),
            areas=np.zeros(MOST_PIXELS),
        )

    def gather(
        self,
        image: NetImage,
        mask: NDArray[np.float32],
        torso: NDArray[np.float32],
    ) -> Clusters:
        """Cluster the votes for torsos, and measure the clusters.

        Parameters
        ----------
        image : NetImage
        mask, torso : (H, W), (4, H, W) float32
            Output of the net.
        """
        n = kernels.collect_votes(image, mask, torso, _LEAST_LOGIT, self._votes)
        votes = self._votes.first(n)
        step = max(1, n // _MOST_VOTES)  # enough to find the centres
        modes = np.empty((_MOST_PEOPLE, 3))
        count = kernels.find_modes(
            votes.points[::step].copy(),
            step * votes.weights[::step],
            self._density,
            _RADIUS_M,
            _LEAST_AREA_M2,
            _MOST_PEOPLE,
            modes,
        )
        modes = modes[:count]
        labels, owner = np.zeros(mask.shape, np.uint8), self._owner[:n]
        kernels.assign_votes(votes.flat, votes.points, modes, _REACH_M, labels, owner)
        measures = np.empty((count, measuring.MEASURES))
        neighbour = np.empty(count, np.int64)
        if count > 0:
            measuring.measure_clusters(image, mask, torso, votes, owner, modes, measures)
            measuring.measure_neighbours(image, labels, modes, measures, neighbour)
        return Clusters(labels, modes, measures, neighbour)
