"""Transfer of detections from the previous frame, without a new search.

People and rooms move little in a thirtieth of a second. While both nets were confident of all people, every
pixel of the next frame takes the person of the nearest previous point, and connected new pixels are added to
the person. If more is new, someone may have come in, and the frame is searched. So is every second frame
(`DetectTuning.find_every`), every fourth while nobody moves, and the first after a gap in the stream. Pixels
in which a search finds nobody, though they showed a person before, are returned to that person.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import SegmentConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import BACKGROUND
from depth_pose.detect import _carry_kernels as kernels
from depth_pose.detect import working_grid
from depth_pose.detect._carry_kernels import Before, CarryLimits
from depth_pose.detect.candidates import Candidates
from depth_pose.detect.finder import LEAST_PIXELS, TorsoDetection
from depth_pose.detect.segmentation import Detection
from depth_pose.detect.tuning import DetectTuning

_MAX_GAP_NS = 50_000_000
"""Maximum gap (ns) between frames; longer ones increase the error."""

_MOVED_M, _MOVED_PIXELS = 0.1, 8
"""Maximum movement of a point, metres and pixels: 3 m/s at 30 frames a second; set by hand."""

_SURE = 0.9
"""Least probability of all people; others are searched again; set by hand."""

_WEAK = 0.5
"""Finder's probability below which a detection takes no pixels of confirmed people; set by hand."""

_STILL_M = 0.05
"""Maximum change of a returned pixel's depth (m); chosen on development clips of .03, .05 and .1."""

_CALM_EVERY = 4
"""Interval between two searches (frames) while nobody moves."""

_MOST_NEW = 0.02
"""Maximum share of people's pixels that may be new; the maximum on development clips is .004; set by hand."""


@dataclass(frozen=True)
class _Before:
    """The people of the previous frame, its stamp, and their pixels after both nets."""

    candidates: Candidates
    stamp_ns: int
    shown: NDArray[np.uint8]


class MaskPropagation:
    """The people of the previous frame.

    Parameters
    ----------
    config : SegmentConfig
    tuning : DetectTuning
    """

    def __init__(self, config: SegmentConfig, tuning: DetectTuning = DetectTuning()) -> None:
        self._config, self._find_every = config, tuning.find_every
        self._limits = CarryLimits(_MOVED_M, tuning.depth_jump, _MOVED_PIXELS)
        self.reset()

    def reset(self) -> None:
        """Forget all people."""
        self._before: _Before | None = None
        self._age = 0

    def carry(self, frame: DepthFrame, *, is_calm: bool = False) -> Candidates | None:
        """Find the people of the previous frame in this one; None if a search is needed.

        Parameters
        ----------
        frame : DepthFrame
        is_calm : bool
            Whether nobody moves: then searches are rarer.
        """
        self._age += 1
        every = _CALM_EVERY if is_calm else self._find_every
        carried = None if self._before is None else self._carry(self._before, frame, every)
        if carried is None:
            self._age = 0
        return carried

    def give_back(self, found: Candidates, stamp_ns: int) -> tuple[Candidates, NDArray[np.bool_] | None]:
        """Return lost pixels to confirmed people of the previous frame, unless another person has them.

        Otherwise a detected bed would take the leg above it, and some searches find only half of a lying
        person. Pixels that stayed where they were go to the detection that shows most of the person; the
        joint net may refuse them.

        Returns
        -------
        Candidates
        (h, w) bool or None
            The returned pixels; None without such a frame just before.
        """
        before = self._before
        if before is None or not 0 < stamp_ns - before.stamp_ns <= _MAX_GAP_NS:
            return found, None
        was = before.candidates
        if found.camera != was.camera:
            return found, None
        labels, is_returned = found.labels.copy(), np.zeros(found.labels.shape, np.bool_)
        strong = [p.label for p in found.people if p.probability >= _WEAK]
        is_free_label = np.ones(256, np.bool_)
        is_free_label[strong] = False
        is_free = is_free_label[labels]
        is_still = np.abs(found.depth - was.depth) < _STILL_M
        for person in was.people:
            shown = is_still & (before.shown == person.label)
            counts = np.bincount(found.labels[shown], minlength=256)
            heir = max(strong, key=lambda label: counts[label], default=BACKGROUND)
            if heir != BACKGROUND and counts[heir] > 0:
                is_returned |= shown & is_free
                labels[shown & is_free] = heir
        return replace(found, labels=labels), is_returned

    def keep(
        self,
        candidates: Candidates,
        detections: Sequence[Detection],
        stamp_ns: int,
        shown: NDArray[np.uint8],
    ) -> None:
        """Keep the confirmed people, and their pixels after both nets; none if one is uncertain."""
        self._before = None
        if not detections or min(s.probability for s in detections) < _SURE:
            return
        sure = {s.label for s in detections}
        people = tuple(p for p in candidates.people if p.label in sure)
        labels = candidates.labels
        for thing in candidates.people:
            if thing.label not in sure:
                labels = np.where(labels == thing.label, np.uint8(BACKGROUND), labels)
        self._before = _Before(replace(candidates, labels=labels, people=people), stamp_ns, shown.copy())

    def _carry(self, before: _Before, frame: DepthFrame, every: int) -> Candidates | None:
        if self._age >= every or not 0 < frame.stamp_ns - before.stamp_ns <= _MAX_GAP_NS:
            return None
        was = before.candidates
        depth, camera = working_grid.reduce_frame(frame, self._config)
        if camera != was.camera:
            return None
        labels, is_new = np.empty(depth.shape, np.uint8), np.empty(depth.shape, np.bool_)
        kernels.carry_labels(Before(was.depth, was.labels), depth, camera, self._limits, labels, is_new)
        if kernels.count_inside(is_new) > _MOST_NEW * np.count_nonzero(labels):
            return None
        kernels.take_new(depth, is_new, self._limits.jump, labels)
        now = Candidates(depth, labels, camera, was.people, was.out_of_range)
        moved = [_moved(person, was, now) for person in was.people]
        return replace(now, people=tuple(p for p in moved if p is not None)) if all(moved) else None


def _moved(person: TorsoDetection, was: Candidates, now: Candidates) -> TorsoDetection | None:
    """Move a person by the mean movement of the points; None if lost."""
    old, new = np.empty(3), np.empty(3)
    kernels.middle_of(was.depth, was.labels, person.label, was.camera, old)
    if kernels.middle_of(now.depth, now.labels, person.label, now.camera, new) < LEAST_PIXELS:
        return None
    return replace(person, torso=person.torso + (new - old))
