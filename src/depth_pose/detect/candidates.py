"""Who may be a person in a depth image, with all that is theirs."""

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
    """Who may be a person in a frame, on the working grid.

    Attributes
    ----------
    depth : (h, w) float32
        Metres; 0 where there is none.
    labels : (h, w) uint8
        The number of the person that a pixel shows; 0: nobody.
    camera : Camera
        Camera of the working grid.
    people : tuple of Detection
    out_of_range : int
        How many more there are too near or too far.
    """

    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    camera: Camera
    people: tuple[Detection, ...]
    out_of_range: int


class CandidateFinder:
    """Finds everybody by `depth_pose.detect.finder`; remembers the room's large planes.

    What the net says is completed along surfaces: hands and feet that it missed go on from somebody's
    surface.

    Parameters
    ----------
    config : SegmentConfig
    weights : path, optional
        A folder with a net in place of the one that ships.

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
        """Find who may be a person."""
        found = self.finder.find(frame)
        return Candidates(found.depth, self._complete(found), found.camera, found.people, found.out_of_range)

    def mark_hidden(self, candidates: Candidates, filled: float) -> NDArray[np.uint8]:
        """Drop flying pixels, and mark what may hide more of people.

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
"""What goes on from somebody is theirs, of whatever shape and wherever it lies, if it is small and likely.
This area and chance gave the best overlap with the truth on 160 simulated scenes."""

_LIMB = {"area": 0.15, "width": 0.13, "chance": 0.05}
"""Away from floor and walls it may be larger and less likely: most that the net misses of a person, square
metres, is an arm and a half, seen from the side; by hand, the chance of .02, .05 and .1 on the development
clips. Without, three people who walk about were 68 mm off instead of 40."""

_APART = _LIMB | {"chance": 0.5}
"""What touches nobody and mostly votes for somebody's torso is theirs as well (a share in place of a chance).

Shanks below a desk: 88.8 to 46.6 mm on that clip. With .7 it is 51.8; in 1200 simulated rooms there is hardly
any such surface, right or wrong (docs/method.md)."""

_CUT_AWAY = 0.5
"""Where more of an image is missing than this share, the background was cut away: it is free space."""
