"""Estimate the person's size over the first frames, then hold it.

A free size in every fit shrinks the body from frame to frame. So sizes on a fixed grid are compared: the
matched exemplar is fitted at each, and scored by rendered depth and by how rare people of that size are. In
the first frame, the size is found by descent on the grid. Every later frame compares only one pair of
neighbouring sizes, alternately above and below the best so far, which bounds the time. Differences within a
frame are more informative than scores of different frames; the size is where their means change sign.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from depth_pose.body.pose import BodyPose
from depth_pose.core.medians import median_of
from depth_pose.match.tuning import MatchTuning
from depth_pose.track.person_view import PersonView
from depth_pose.track.state import SizeSearch

SCALES = 0.6 * 1.04 ** np.arange(-3, 18)
"""Grid of sizes: statures from 0.93 m to 2.05 m for a body of 1.75 m."""

_RARE = 1.0
"""Penalty of tall people, times the squared log ratio to 1.75 m, which compensates loose clothes; chosen on
real people and simulated builds."""

_RARITY = _RARE * np.maximum(np.log(SCALES), 0.0) ** 2
"""Rarity term of each of `SCALES`."""

_MOST_STEPS = 5
"""Maximum number of 4 % steps from the first guess, which bounds the time of the first frame."""

_MORE = 1.2
"""Factor by which more of a cut-off person must be visible before the size is estimated again."""

_WHOLE_FRAMES = 5
"""Consecutive frames in which a formerly cut-off person is whole before the size is estimated again; 2 and
10 err as much."""


class Trial(Protocol):
    """Compares poses of a person by short fits (`depth_pose.refine.short_fit`)."""

    def scorer(self, person: PersonView) -> Callable[[BodyPose], float]:
        """Return a function from a start to the rendered-depth disagreement after a fit."""


class SizeFinder:
    """Estimates sizes; `SizeSearch` is the state of one person's estimate.

    Parameters
    ----------
    trial : Trial
    scale : float
        The configured size; 0: estimated.
    frames : int
        Number of frames from which a size is estimated before it is held.
    """

    def __init__(self, trial: Trial, scale: float = 0.0, frames: int = MatchTuning().scale_frames) -> None:
        self._trial, self._given, self._frames = trial, scale, frames

    def is_known(self, search: SizeSearch) -> bool:
        """Check that the size is configured, or estimated and held."""
        return self._given > 0.0 or search.frames >= self._frames

    def so_far(self, search: SizeSearch) -> float | None:
        """Return the current estimate; None before a person's first frame."""
        return self.scale(search) if self._given > 0.0 or search.frames > 0 else None

    def scale(self, search: SizeSearch) -> float:
        """Return the configured size, or the one with the least score, by a parabola near the minimum."""
        if self._given > 0.0:
            return self._given
        k, counts = search.at, search.counts
        if k == 0 or k == len(SCALES) - 1 or min(counts[k - 1], counts[k]) == 0:
            return float(SCALES[k])
        below, above = search.rises[k - 1 : k + 1] / counts[k - 1 : k + 1]
        step = 0.5 * (-below - above) / (above - below) if above > 0.0 > below else 0.0
        return float(SCALES[k] * (SCALES[1] / SCALES[0]) ** step)

    def watch(self, search: SizeSearch, person: PersonView) -> SizeSearch:
        """Restart the estimate of a person who was partly cut off or hidden, as more becomes visible."""
        if not (person.is_cut_beside or person.is_cut_below):
            whole = search.whole + 1
            return (
                SizeSearch() if search.is_partial and whole >= _WHOLE_FRAMES else search._replace(whole=whole)
            )
        shown = len(person.points) * float(median_of(person.points[:, 2].copy())) ** 2
        if search.is_partial and shown > _MORE * search.shown:
            return SizeSearch(is_partial=True, shown=shown)
        if not search.is_partial and not self.is_known(search):
            return search._replace(is_partial=True, shown=shown, whole=0)
        return search._replace(whole=0)

    def add(self, search: SizeSearch, person: PersonView, start: BodyPose) -> SizeSearch:
        """Add a frame to the estimate.

        Parameters
        ----------
        search : SizeSearch
        person : PersonView
        start : BodyPose
            The matched pose, at a size near the person's.
        """
        fit, scored = self._trial.scorer(person), dict[int, float]()

        def score(k: int) -> float:
            if k not in scored:
                fitted = fit(BodyPose(start.rotations, start.root, float(SCALES[k])))
                scored[k] = fitted + float(_RARITY[k])
            return scored[k]

        if search.frames == 0:
            at = _descend(score, int(np.argmin(np.abs(np.log(SCALES / start.scale)))))
            rises, counts = np.zeros(len(SCALES) - 1), np.zeros(len(SCALES) - 1, np.int64)
        else:
            at, rises, counts = search.at, search.rises.copy(), search.counts.copy()
            low = _next_pair(search)
            score(low), score(low + 1)
        for k in scored:
            if k + 1 in scored:
                rises[k] += scored[k + 1] - scored[k]
                counts[k] += 1
        if at < len(SCALES) - 1 and rises[at] < 0.0:
            at += 1
        elif at > 0 and rises[at - 1] > 0.0:
            at -= 1
        return search._replace(frames=search.frames + 1, at=at, rises=rises, counts=counts)


def _next_pair(search: SizeSearch) -> int:
    """Return the lower size of the less often compared pair beside the best size."""
    below, above = max(0, search.at - 1), min(len(SCALES) - 2, search.at)
    return below if search.counts[below] < search.counts[above] else above


def _descend(score: Callable[[int], float], k: int) -> int:
    """Descend to a size that is better than both neighbours, in a few steps at most."""
    for _ in range(_MOST_STEPS):
        best = min(range(max(0, k - 1), min(len(SCALES), k + 2)), key=score)
        if best == k:
            break
        k = best
    return k
