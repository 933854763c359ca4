"""Find the person's size over the first frames, then hold it.

Freeing the size in every fit shrinks the body, frame by frame. So sizes on a fixed grid are
compared: the matched exemplar is fitted at each, and scored by rendered depth. The first frame
walks downhill on the grid, from where the finder's joints say that the size is. Every further one
compares just one pair of neighbouring sizes, above or below the best so far in turn, so that no
frame takes long. Differences within a frame say more than scores of different frames; the size is
where their means change sign.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from depth_pose.body.body import Body
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, JOINTS
from depth_pose.core.types import FoundPerson
from depth_pose.fit.articulated import ArticulatedFitter, BodyPose
from depth_pose.people.person import Person
from depth_pose.steps.short_fits import TrialFits

SCALES = 0.6 * 1.04 ** np.arange(18)
"""Sizes that are tried: statures from 1.05 m to 2.05 m for a body of 1.75 m."""

_MOST_STEPS = 5
"""Steps of 4 % from the first guess, at most: so that the first frame does not take long."""


_GUESSED = tuple(
    (JOINT_INDEX[start], JOINT_INDEX[end])
    for start, end in (
        ("pelvis", "neck"),
        ("pelvis", "head"),
        ("left_shoulder", "right_shoulder"),
        *((f"{s}_{a}", f"{s}_{b}") for s in ("left", "right")
          for a, b in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"))),
    )
)  # fmt: skip
"""Pairs of joints whose distances tell the size."""

_LONGER = 1.12
"""Found sizes are larger than proposals of joints say, which draw toward the middle: mean of eight people of
the development clips, from 1.02 to 1.24."""


def guess_scale(body: Body, found: FoundPerson) -> float:
    """Guess a person's size from the finder's proposals; 0 where there are none."""
    if len(found.proposals) != len(JOINTS):
        return 0.0
    start, end = np.array(_GUESSED).T
    rest, seen = body.nodes[JOINT_NODES], found.proposals.astype(np.float64)
    weights = np.minimum(found.proposal_confidence[start], found.proposal_confidence[end])
    lengths = np.linalg.norm(seen[end] - seen[start], axis=1)
    whole = float(weights @ np.linalg.norm(rest[end] - rest[start], axis=1))
    if whole <= 0.0:
        return 0.0
    return float(np.clip(_LONGER * float(weights @ lengths) / whole, SCALES[0], SCALES[-1]))


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
                scored[k] = trial.score(BodyPose(start.rotations, start.root, float(SCALES[k])))
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
