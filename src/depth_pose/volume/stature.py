"""Estimate the height of the person from the first frames.

The start is the height at which the descriptors agree best with the model; then the fits of the body to the
volumes correct it by a factor, with decreasing steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.volume.config import TrackConfig
from depth_pose.volume.hull import Volume
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.tracker import describe_headings, search_costs
from depth_pose.volume.tuning import TrackTuning

# Chosen like the defaults of `depth_pose.volume.config`.
_GRID_M = np.arange(1.05, 2.06, 0.025)
"""Heights tried, metres: from a child's to a tall adult's."""
_NEAR_M = 0.08
"""Range around the best height in which others are tried after the first frame, metres."""
_HEADING_STRIDE = 4
"""Step between the fine headings tried."""
_SEARCH_FRAMES = 8
"""Number of frames in which heights are searched; later, the height follows the fits."""
_GAIN = 12.0
"""Step toward the fits' factor: frame n has the weight of this over n."""
_MOST_STEP = 0.5
"""Maximum weight of one frame's factor."""
_FACTORS = (0.9, 1.1)
"""A fit with a larger factor than this has failed."""


class StatureFinder:
    """Estimates the stature over a number of frames and then holds it.

    The first frame tries all heights, the next ones those near the best so far; a height's cost is
    that of the training frame and heading that suit it best, averaged over the frames that tried it.
    """

    def __init__(self, model: VolumeModel, config: TrackConfig, tuning: TrackTuning = TrackTuning()) -> None:
        self._model, self._config, self._tuning = model, config, tuning
        self.reset()

    def reset(self) -> None:
        """Start again."""
        self._cost, self._count = np.zeros(len(_GRID_M)), np.zeros(len(_GRID_M))
        self._frames = 0
        self.stature = self._config.stature

    @property
    def is_held(self) -> bool:
        """Whether the stature is settled."""
        return self._config.stature > 0 or self._frames >= self._tuning.stature_frames

    def update(self, volume: Volume) -> float:
        """Add the volume of one frame, which is not empty; return the stature in metres."""
        if self.is_held:
            return self.stature
        if self._frames < min(_SEARCH_FRAMES, self._tuning.stature_frames):
            self._search(volume)
        self._frames += 1
        return self.stature

    def follow(self, factor: float) -> None:
        """Add the factor on the body's size that one frame's fit suggests."""
        if not self.is_held and self._frames >= _SEARCH_FRAMES:
            gain = min(_MOST_STEP, _GAIN / self._frames)
            self.stature *= float(np.clip(factor, *_FACTORS)) ** gain

    def _search(self, volume: Volume) -> None:
        tried = np.arange(len(_GRID_M))
        if self._frames:
            tried = tried[np.abs(_GRID_M - self.stature) < _NEAR_M]
        window: NDArray[np.int64] = np.arange(0, self._model.bins.fine, _HEADING_STRIDE)
        for i in tried:
            sights = describe_headings(volume, float(_GRID_M[i]), self._model.bins)
            self._cost[i] += search_costs(self._model, sights, window).min() / len(sights)
            self._count[i] += 1
        tries = self._frames + 1
        mean = np.where(self._count > 0.5 * tries, self._cost / np.maximum(self._count, 1), np.inf)
        self.stature = float(_GRID_M[np.argmin(mean)])
