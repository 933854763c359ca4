"""Person candidates in a depth image, with their masks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.types import BACKGROUND, HIDDEN, DepthFrame
from depth_pose.detect import _border_kernels as kernels
from depth_pose.detect.finder import Detection, Detections, PeopleFinder, load_weights
from depth_pose.detect.planes import PlaneFinder


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
    people : tuple of Detection
    out_of_range : int
        Number of further people who are too near or too far.
    """

    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    camera: Camera
    people: tuple[Detection, ...]
    out_of_range: int


class CandidateFinder:
    """Finds person candidates by `depth_pose.detect.finder`; remembers the room's large planes.

    The net's masks are completed along surfaces, which adds hands and feet that it missed.

    Parameters
    ----------
    config : SegmentConfig
    weights : path, optional
        Folder with a net in place of the packaged one.

    Attributes
    ----------
    finder : PeopleFinder
    """

    def __init__(self, config: SegmentConfig, weights: Path | None = None) -> None:
        self._config = config
        self.finder = PeopleFinder(config, *load_weights(weights))
        self._planes = PlaneFinder()

    def reset(self) -> None:
        """Forget the room."""
        self._planes.reset()

    def find(self, frame: DepthFrame) -> Candidates:
        """Find the person candidates of a frame."""
        found = self.finder.find(frame)
        return Candidates(found.depth, self._complete(found), found.camera, found.people, found.out_of_range)

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
            Their labels, and `depth_pose.core.types.HIDDEN`.
        """
        depth, labels, jump = candidates.depth, candidates.labels.copy(), self._config.depth_jump
        kernels.mark_unsupported(depth, labels, jump, self._config.min_support)
        missing = depth == 0
        if missing.mean() < 1.0 - filled * (1.0 - _CUT_AWAY):
            labels[missing] = HIDDEN
        kernels.mark_nearer(depth, labels, candidates.camera, jump)
        return labels

    def _complete(self, found: Detections) -> NDArray[np.uint8]:
        """Add limbs that the net missed."""
        depth, camera, jump = found.depth, found.camera, self._config.depth_jump
        labels = found.labels.copy()
        if found.people:
            kernels.attach_limbs(depth, labels, found.chance, camera, _HAND)
            planes = self._planes.mark(camera.back_project(depth), camera)
            free = np.where(planes & (labels == BACKGROUND), np.float32(0), depth)
            kernels.attach_limbs(free, labels, found.chance, camera, kernels.LimbLimits(jump, **_LIMB))
            kernels.attach_apart(free, labels, found.claims, camera, kernels.LimbLimits(jump, **_APART))
        return labels


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
