"""Estimate the person's size over the first frames, then hold it.

A free size in every fit shrinks the body from frame to frame. So sizes on a fixed grid are compared: the
matched exemplar is fitted at each, and scored by rendered depth and by how rare people of that size are. The
first frame descends on the grid. Every later frame compares only one pair of neighbouring sizes, alternately
above and below the best so far, which bounds the time. Differences within a frame are more informative than
scores of different frames; the size is where their means change sign.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from depth_pose.body.pose import BodyPose
from depth_pose.match.trial_fits import TrialFits
from depth_pose.track.person_view import PersonView

if TYPE_CHECKING:
    from depth_pose.refine.articulated import ArticulatedFitter

SCALES = 0.6 * 1.04 ** np.arange(-3, 18)
"""Grid of sizes: statures from 0.93 m to 2.05 m for a body of 1.75 m."""

_RARE = 1.0
"""Score of tall people, times the squared log ratio to 1.75 m; it compensates loose clothes; chosen on
real people and simulated builds."""

_RARITY = _RARE * np.maximum(np.log(SCALES), 0.0) ** 2
"""Rarity term of each of `SCALES`."""

_MOST_STEPS = 5
"""Maximum number of 4 % steps from the first guess, which bounds the time of the first frame."""


class ScaleFinder:
    """Accumulates, over frames, the score differences between neighbouring sizes."""

    def __init__(self, fitter: ArticulatedFitter, band: float) -> None:
        self._fitter = fitter
        self._band = band
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self.frames = 0
        self._at = 0
        self._rises = np.zeros(len(SCALES) - 1)
        self._counts = np.zeros(len(SCALES) - 1, np.int64)

    @property
    def scale(self) -> float:
        """Size with the least score, by a parabola near the minimum; defined after the first frame."""
        k = self._at
        if k == 0 or k == len(SCALES) - 1 or min(self._counts[k - 1], self._counts[k]) == 0:
            return float(SCALES[k])
        below, above = self._rises[k - 1 : k + 1] / self._counts[k - 1 : k + 1]
        step = 0.5 * (-below - above) / (above - below) if above > 0.0 > below else 0.0
        return float(SCALES[k] * (SCALES[1] / SCALES[0]) ** step)

    def add(self, person: PersonView, start: BodyPose) -> None:
        """Add a frame to the estimate.

        Parameters
        ----------
        person : PersonView
        start : BodyPose
            The matched pose, at a size near the person's.
        """
        trial = TrialFits(self._fitter, self._band, person)
        scored: dict[int, float] = {}

        def score(k: int) -> float:
            if k not in scored:
                fitted = trial.score(BodyPose(start.rotations, start.root, float(SCALES[k])))
                scored[k] = fitted + float(_RARITY[k])
            return scored[k]

        if self.frames == 0:
            self._at = _descend(score, int(np.argmin(np.abs(np.log(SCALES / start.scale)))))
        else:
            low = self._pair()
            score(low), score(low + 1)
        for k in scored:
            if k + 1 in scored:
                self._rises[k] += scored[k + 1] - scored[k]
                self._counts[k] += 1
        self.frames += 1
        self._move()

    def _pair(self) -> int:
        """Return the lower size of the less often compared pair beside the best size."""
        below, above = max(0, self._at - 1), min(len(SCALES) - 2, self._at)
        return below if self._counts[below] < self._counts[above] else above

    def _move(self) -> None:
        """Move to the next size if the mean difference favours it."""
        k = self._at
        if k < len(SCALES) - 1 and self._rises[k] < 0.0:
            self._at = k + 1
        elif k > 0 and self._rises[k - 1] > 0.0:
            self._at = k - 1


def _descend(score: Callable[[int], float], k: int) -> int:
    """Descend to a size that is better than both neighbours, in a few steps at most."""
    for _ in range(_MOST_STEPS):
        best = min(range(max(0, k - 1), min(len(SCALES), k + 2)), key=score)
        if best == k:
            break
        k = best
    return k
