"""Gather what the people finder's net votes for: clusters around torsos.

Votes for one torso gather, so people are split by where they are, not by what touches (Hough voting as in
Leibe et al. 2008, from every pixel as in Girshick et al. 2011).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.detect import _finder_kernels as grid
from depth_pose.detect import _measure_kernels as measuring
from depth_pose.detect import _vote_kernels as kernels
from depth_pose.detect._finder_kernels import NetImage

_LEAST_LOGIT = -0.62
"""A pixel votes from a probability of .35 on (the trial's; .3 to .4 made no difference)."""

_RADIUS_M = 0.3
"""Votes within it are one torso's; two people side by side are .45 m apart or more."""

_REACH_M = 0.5
"""A vote farther than this from every torso is nobody's."""

_MOST_VOTES = 1000
"""As many votes, about, are looked at to find the torsos; all are then given to them."""

_LEAST_AREA_M2 = 0.02
"""Weight of votes that a torso needs, square metres of surface. Set by hand, not swept."""
_MOST_PEOPLE = 24
"""Torsos that are found in a frame, at most. Set by hand."""


@dataclass(frozen=True)
class Clusters:
    """What gathers around each torso, before anybody asked whether it is a person.

    Attributes
    ----------
    labels : (ROWS, COLS) uint8
        From 1; 0: nobody.
    torsos : (P, 3) float64
    measures : (P, MEASURES) float64
        What the verifier asks for.
    neighbour : (P,) int64
        The nearest cluster with more area, -1 for none near.
    """

    labels: NDArray[np.uint8]
    torsos: NDArray[np.float64]
    measures: NDArray[np.float64]
    neighbour: NDArray[np.int64]


class VoteGatherer:
    """Finds where votes for torsos gather; keeps its work space from frame to frame, and nothing else."""

    def __init__(self) -> None:
        shape = (grid.ROWS, grid.COLS)
        size = shape[0] * shape[1]
        self._density = np.zeros(int(np.prod(kernels.CELLS)))
        self._owner = np.zeros(size, np.int64)
        self._votes = kernels.TorsoVotes(
            flat=np.zeros(size, np.int64),
            points=np.zeros((size, 3)),
            weights=np.zeros(size),
            areas=np.zeros(size),
        )

    def gather(
        self,
        image: NetImage,
        mask: NDArray[np.float32],
        torso: NDArray[np.float32],
    ) -> Clusters:
        """Find where votes for torsos gather, and measure those who cast them.

        Parameters
        ----------
        image : NetImage
        mask, torso : (ROWS, COLS), (4, ROWS, COLS) float32
            What the net says.
        """
        n = kernels.collect_votes(image, mask, torso, _LEAST_LOGIT, self._votes)
        votes = self._votes.first(n)
        step = max(1, n // _MOST_VOTES)  # enough to find the middles
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
