"""Cut everybody out of a depth image with the learned people finder (the default)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.types import BACKGROUND, HIDDEN, DepthFrame
from depth_pose.people import _segment_kernels as kernels
from depth_pose.people.finder import PeopleFinder
from depth_pose.people.segmentation import Segmentation, Sighting


class LearnedSegmenter:
    """Finds everybody by `depth_pose.people.finder`; keeps nothing from frame to frame."""

    def __init__(self, config: SegmentConfig) -> None:
        self.config = config
        self._finder = PeopleFinder(config)

    def reset(self) -> None:
        """Forget nothing: nothing is kept."""

    def warm_up(self) -> None:
        """Compile every kernel, and load the net."""
        rows, cols = np.mgrid[:120, :160]
        depth = np.where(np.hypot(rows - 60, 3.0 * (cols - 80)) < 50, 2.0, 4.0).astype(np.float32)
        self.segment(DepthFrame(0, "", depth, Camera(160, 120, 140.0, 140.0, 79.5, 59.5)))

    def segment(self, frame: DepthFrame) -> Segmentation:
        """Label every pixel of the working grid."""
        found = self._finder.find(frame)
        people = take_ends(found.depth, found.labels, found.camera, self.config.depth_jump)
        labels = self._mark_hidden(found.depth, people, found.camera)
        is_person = (labels != BACKGROUND) & (labels != HIDDEN)
        return Segmentation(
            depth=np.where(is_person, found.depth, np.float32(0)),
            labels=labels,
            camera=found.camera,
            sightings=tuple(
                Sighting(
                    label=p.label,
                    place=p.torso,
                    probability=p.probability,
                    proposals=p.joints.astype(np.float32),
                    proposal_confidence=p.joint_confidence,
                )
                for p in found.people
            ),
        )

    def _mark_hidden(
        self, depth: NDArray[np.float32], people: NDArray[np.uint8], camera: Camera
    ) -> NDArray[np.uint8]:
        """Drop flying pixels, and mark what is nearer than the people beside it, or did not return."""
        jump = self.config.depth_jump
        labels = people.copy()
        for label in range(1, int(people.max()) + 1):
            own = people == label
            kept = kernels.filter_support(depth, own, jump, self.config.min_support)
            labels[own & ~kept] = HIDDEN
        missing = depth == 0
        if missing.mean() < _CUT_AWAY:
            labels[missing] = HIDDEN
        kernels.mark_nearer(depth, labels, camera, jump)
        return labels


def take_ends(
    depth: NDArray[np.float32], people: NDArray[np.uint8], camera: Camera, jump: float
) -> NDArray[np.uint8]:
    """Give people the ends of their limbs that the net left out.

    A surface that goes on from a person, is small, and touches nothing else is a hand or a foot: left
    as background it would be free space, where the fit lets no limb be.

    Parameters
    ----------
    depth : (h, w) float32
        Metres, 0 where nothing returned.
    people : (h, w) uint8
        Number of each pixel's person, 0 for nobody.
    camera : Camera
    jump : float
        Neighbours this far apart in depth are different surfaces, metres.
    """
    rest, count = kernels.label_components(depth, (people == 0) & (depth > 0), jump)
    areas = np.bincount(rest.ravel(), (depth * depth / (camera.fx * camera.fy)).ravel(), count + 1)
    owner = np.zeros(count + 1, np.uint8)
    for a, b in _NEIGHBOURS:
        goes_on = (rest[a] > 0) & (people[b] > 0) & (np.abs(depth[a] - depth[b]) <= jump)
        owner[rest[a][goes_on]] = people[b][goes_on]
    owner[areas > _END_M2] = 0
    owner[0] = 0
    return np.where(people == 0, owner[rest], people)


_END_M2 = 0.05
"""Most of a limb that the net leaves out, square metres: a forearm with its hand."""

_NEIGHBOURS = (
    (np.s_[1:], np.s_[:-1]),
    (np.s_[:-1], np.s_[1:]),
    (np.s_[:, 1:], np.s_[:, :-1]),
    (np.s_[:, :-1], np.s_[:, 1:]),
)
"""Two parts of an image that lie one pixel beside each other, for each direction."""

_CUT_AWAY = 0.5
"""Where more of an image is missing than this share, the background was cut away: it is free space."""
