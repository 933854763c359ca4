"""Find the person's size over the first frames, then hold it.

Freeing the size in every fit shrinks the body, frame by frame. So sizes on a fixed grid are
compared: the matched exemplar is fitted at each, and scored by rendered depth and by how rare
people of that size are. The first frame walks downhill on the grid. Every further one compares just
one pair of neighbouring sizes, above or below the best so far in turn, so that no frame takes long.
Differences within a frame say more than scores of different frames; the size is where their means
change sign.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from depth_pose.body.pose import BodyPose
from depth_pose.match.trial_fits import TrialFits
from depth_pose.track.person import Person

if TYPE_CHECKING:
    from depth_pose.refine.articulated import ArticulatedFitter

SCALES = 0.6 * 1.04 ** np.arange(-3, 18)
"""Sizes that are tried: statures from 0.93 m to 2.05 m for a body of 1.75 m."""

_RARE = 1.0
"""Score of people taller than 1.75 m, times the square of the logarithm of how much: .01 at 1.93 m.

Loose clothes make people look larger than they are. Without, two of eight real people seemed to be 2.05 m
tall and their feet lay below the image of them; with 3, eleven people of random builds, two of whom are that
tall, are off by 22.7 mm instead of 21.6 (docs/accuracy.md)."""

_RARITY = _RARE * np.maximum(np.log(SCALES), 0.0) ** 2
"""What each of `SCALES` adds to its score: `_RARE` times that square."""

_MOST_STEPS = 5
"""Steps of 4 % from the first guess, at most: so that the first frame does not take long."""


class ScaleFinder:
    """Sums, over frames, how much worse a fit gets from each size to the next."""

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
        """Size at which the score, a parabola near its minimum, is lowest; once there was a frame."""
        k = self._at
        if k == 0 or k == len(SCALES) - 1 or min(self._counts[k - 1], self._counts[k]) == 0:
            return float(SCALES[k])
        below, above = self._rises[k - 1 : k + 1] / self._counts[k - 1 : k + 1]
        step = 0.5 * (-below - above) / (above - below) if above > 0.0 > below else 0.0
        return float(SCALES[k] * (SCALES[1] / SCALES[0]) ** step)

    def add(self, person: Person, start: BodyPose) -> None:
        """Take a frame into account.

        Parameters
        ----------
        person : Person
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
        """Lower size of the pair beside the best size that was compared less often."""
        below, above = max(0, self._at - 1), min(len(SCALES) - 2, self._at)
        return below if self._counts[below] < self._counts[above] else above

    def _move(self) -> None:
        """Go to the next size if the mean difference says that it is better."""
        k = self._at
        if k < len(SCALES) - 1 and self._rises[k] < 0.0:
            self._at = k + 1
        elif k > 0 and self._rises[k - 1] > 0.0:
            self._at = k - 1


def _descend(score: Callable[[int], float], k: int) -> int:
    """Walk to a size that is better than both its neighbours, a few steps at most."""
    for _ in range(_MOST_STEPS):
        best = min(range(max(0, k - 1), min(len(SCALES), k + 2)), key=score)
        if best == k:
            break
        k = best
    return k
