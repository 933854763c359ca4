"""Person candidates in a depth image, with their masks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import BACKGROUND, HIDDEN
from depth_pose.detect import _border_kernels as kernels
from depth_pose.detect.background import StillBackground
from depth_pose.detect.finder import FinderResult, PeopleFinder, TorsoDetection, load_weights
from depth_pose.detect.planes import PlaneFinder
from depth_pose.detect.tuning import DetectTuning


@dataclass(frozen=True)
class Candidates:
    """Person candidates of a frame, on the working grid.

    Attributes
    ----------
    depth : (h, w) float32
        Metres; 0 without depth.
    labels : (h, w) uint8
        Number of the person at each pixel; 0: background.
    camera : Camera
        Camera of the working grid.
    people : tuple of TorsoDetection
    out_of_range : int
        Number of further people who are too near or too far.
    """

    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    camera: Camera
    people: tuple[TorsoDetection, ...]
    out_of_range: int


class CandidateFinder:
    """Finds person candidates by `depth_pose.detect.finder`; remembers the room's planes and background.

    The net's masks are completed along surfaces, which adds hands and feet that it missed.

    Parameters
    ----------
    config : SegmentConfig
    weights : path, optional
        Folder with a net in place of the packaged one.
    tuning : DetectTuning

    Attributes
    ----------
    finder : PeopleFinder
    """

    def __init__(
        self, config: SegmentConfig, weights: Path | None = None, tuning: DetectTuning = DetectTuning()
    ) -> None:
        self._config, self._tuning = config, tuning
        self.finder = PeopleFinder(config, *load_weights(weights), tuning)
        self._planes, self._background = PlaneFinder(), StillBackground()
        self.reset()

    @property
    def is_still(self) -> bool:
        """Whether the camera has not moved between the last two searched frames."""
        return self._background.is_still

    def warm_up(self) -> None:
        """Compile the kernels that a single image does not need."""
        self._background.warm_up()

    def reset(self) -> None:
        """Forget the room."""
        self._planes.reset()
        self._background.reset()
        self._turns, self._doubts = 0, 0

    def find(self, frame: DepthFrame) -> Candidates:
        """Find the person candidates of a frame."""
        found = self._find_turned(frame)
        labels = self._complete(found)
        return Candidates(found.depth, labels, found.camera, found.people, found.out_of_range)

    def _find_turned(self, frame: DepthFrame) -> FinderResult:
        """Find people in the image with the last useful rotation; in doubt, sometimes with another one."""
        found = self.finder.find(frame, self._turns, self._background)
        doubtful = [p for p in found.people if p.probability < self._tuning.sure]
        if found.people and not doubtful:
            self._doubts = 0
            return found
        if self._turns and not found.people:  # the person for whom it was rotated has left
            self._turns, self._doubts = 0, 0
            return found
        self._doubts += 1
        if self._doubts % _TRY_EVERY != 1:
            return found
        other = (self._turns + _TURNS[self._doubts // _TRY_EVERY % len(_TURNS)]) % 4
        tried = self.finder.find(frame, other)
        if not self._is_better(doubtful, found, tried, across=other % 2 == 1):
            return found
        self._turns, self._doubts = other, 0
        return tried

    def _is_better(
        self, doubtful: list[TorsoDetection], found: FinderResult, tried: FinderResult, across: bool
    ) -> bool:
        """Whether another rotation confirms a doubtful or missed person, and keeps all who were confirmed.

        After a quarter turn only people who lie ``across`` the original image count: upright posts lie across
        the rotated one.
        """
        sure = [p for p in tried.people if p.probability >= self._tuning.sure]

        def has(person: TorsoDetection, people: list[TorsoDetection]) -> bool:
            return any(np.linalg.norm(person.torso - p.torso) < _SAME_M for p in people)

        kept = all(has(p, sure) for p in found.people if p.probability >= self._tuning.sure)
        gained = [p for p in sure if not found.people or has(p, doubtful)]
        return kept and any(not across or lies_across(tried.labels == p.label) for p in gained)

    def mark_hidden(self, candidates: Candidates, filled: float) -> NDArray[np.uint8]:
        """Remove flying pixels, and mark occluders of people.

        Parameters
        ----------
        candidates : Candidates
        filled : float
            `DepthFrame.filled`.

        Returns
        -------
        (h, w) uint8
            Their labels, and `depth_pose.core.labels.HIDDEN`.
        """
        depth, labels, jump = candidates.depth, candidates.labels.copy(), self._tuning.depth_jump
        kernels.mark_unsupported(depth, labels, jump, self._tuning.min_support)
        missing = depth == 0
        if missing.mean() < 1.0 - filled * (1.0 - _CUT_AWAY):
            labels[missing] = HIDDEN
        kernels.mark_nearer(depth, labels, candidates.camera, jump)
        return labels

    def _complete(self, found: FinderResult) -> NDArray[np.uint8]:
        """Add limbs that the net missed."""
        depth, camera, jump = found.depth, found.camera, self._tuning.depth_jump
        labels = found.labels.copy()
        if found.people:
            kernels.attach_limbs(depth, labels, found.chance, camera, _HAND)
            planes = self._planes.mark(camera.back_project(depth), camera)
            free = np.where(planes & (labels == BACKGROUND), np.float32(0), depth)
            kernels.attach_limbs(free, labels, found.chance, camera, kernels.LimbLimits(jump, **_LIMB))
            kernels.attach_apart(free, labels, found.claims, camera, kernels.LimbLimits(jump, **_APART))
        return labels


def lies_across(own: NDArray[np.bool_]) -> bool:
    """Check that the marked pixels (h, w) extend farther along rows than along columns."""
    rows, columns = np.nonzero(own)
    return len(rows) > 0 and bool(columns.std() > _ACROSS * rows.std())


_ACROSS = 1.3
"""A person who lies across the image extends this many times farther along its rows. Half and double
answer the same in rooms."""

_TRY_EVERY, _TURNS = 4, (1, 3, 2)
"""Searches between two rotated images while there is doubt, and the quarter turns to try in order. Half
or double changes at most .4 mm in rooms."""

_SAME_M = 0.3
"""Torsos nearer to each other than this belong to one person, metres. Half and double answer
the same in rooms."""

_HAND = kernels.LimbLimits(jump=0.06, area=0.07, width=np.inf, chance=0.15)
"""Limits of an adjacent surface of any shape and place; area and probability chosen on 160 simulated
scenes."""

_LIMB = {"area": 0.15, "width": 0.13, "chance": 0.05}
"""Limits away from floor and walls, where the surface may be larger and less probable: an arm and a half
(m^2); probability chosen on development clips."""

_APART = _LIMB | {"chance": 0.5}
"""Limits of separate surfaces that mostly vote for one torso (a share in place of the probability); chosen
on a clip with shanks below a desk."""

_CUT_AWAY = 0.5
"""Share of missing pixels above which the background was removed and counts as free space."""
