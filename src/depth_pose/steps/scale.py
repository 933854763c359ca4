"""Find the person's size over the first frames, then hold it.

Freeing the size in every fit shrinks the body, frame by frame. So sizes on a fixed grid are
tried: at each, the matched exemplars are fitted and compared by rendered depth, and the scores
are summed over the first frames. Only the neighbours of the best size so far are fitted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.registration.articulated import ArticulatedFitter, BodyPose, FitTarget
from depth_pose.render import DepthComparer
from depth_pose.steps.view import PersonView, thin

SCALES = 0.6 * 1.04 ** np.arange(18)
"""Sizes that are tried: statures from 1.05 m to 2.05 m for a body of 1.75 m."""

_POINTS = 400
_SIGMAS = (0.06, 0.05, 0.04, 0.034, 0.028, 0.024)
_MOST_STEPS = 5


class ScaleFinder:
    """Sums, over frames, the score of fits at each size."""

    def __init__(self, fitter: ArticulatedFitter, band: float) -> None:
        self._fitter = fitter
        self._band = band
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self.frames = 0
        self._sums = np.zeros(len(SCALES))
        self._counts = np.zeros(len(SCALES), np.int64)

    @property
    def scale(self) -> float:
        """Size with the lowest mean score so far, by a parabola through its neighbours."""
        means = self._means()
        k = int(np.argmin(means))
        if k in (0, len(SCALES) - 1) or not np.isfinite(means[k - 1 : k + 2]).all():
            return float(SCALES[k])
        low, here, high = means[k - 1 : k + 2]
        curve = low - 2 * here + high
        step = 0.5 * (low - high) / curve if curve > 0 else 0.0
        return float(SCALES[k] * (SCALES[1] / SCALES[0]) ** step)

    def add(self, view: PersonView, starts: list[BodyPose]) -> None:
        """Take a frame into account.

        Parameters
        ----------
        view : PersonView
        starts : list of BodyPose
            Matched poses, at a size near the person's.
        """
        if self.frames == 0:
            k = int(np.argmin(np.abs(np.log(SCALES / starts[0].scale))))
        else:
            k = int(np.argmin(self._means()))
        scored: dict[int, float] = {}
        for _ in range(_MOST_STEPS):
            for i in range(max(0, k - 1), min(len(SCALES), k + 2)):
                if i not in scored:
                    scored[i] = self._score(view, starts, float(SCALES[i]))
            best = min(scored, key=lambda i: scored[i])
            if best == k:
                break
            k = best
        for i, score in scored.items():
            self._sums[i] += score
            self._counts[i] += 1
        self.frames += 1

    def _means(self) -> NDArray[np.float64]:
        """Mean score of each size; infinite where most frames did not try it."""
        tried = 2 * self._counts > self.frames
        return np.where(tried, self._sums / np.maximum(self._counts, 1), np.inf)

    def _score(self, view: PersonView, starts: list[BodyPose], scale: float) -> float:
        comparer = DepthComparer(view.coarse, self._band)
        target = FitTarget.prepare(thin(view.points, _POINTS), view.full, view.coarse)
        best = np.inf
        for start in starts:
            at_scale = BodyPose(start.rotations, start.root, scale)
            pose = self._fitter.fit(target, at_scale, _SIGMAS)
            posed = self._fitter.body.pose(pose.rotations, pose.root, scale)
            best = min(best, comparer.compare(posed.vertices, self._fitter.body.faces).score)
        return float(best)
