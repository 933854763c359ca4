"""Cut everybody out of a depth image with the learned people finder (the default)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.types import BACKGROUND, HIDDEN, DepthFrame
from depth_pose.people import _segment_kernels as kernels
from depth_pose.people.finder import Detection, Detections, PeopleFinder
from depth_pose.people.joint_finder import JointFinder
from depth_pose.people.planes import PlaneFinder
from depth_pose.people.segmentation import Segmentation, Sighting


class LearnedSegmenter:
    """Finds everybody by `depth_pose.people.finder`; remembers the room's large planes.

    What the net says is completed along surfaces: hands and feet that it missed go on from somebody's
    surface once floor and walls are taken out.
    """

    def __init__(self, config: SegmentConfig) -> None:
        self.config = config
        self._finder = PeopleFinder(config)
        self._joints = JointFinder()
        self._planes = PlaneFinder()

    def reset(self) -> None:
        """Forget the room."""
        self._planes.reset()

    def warm_up(self) -> None:
        """Compile every kernel, and load the net."""
        rows, cols = np.mgrid[:120, :160]
        depth = np.where(np.hypot(rows - 60, 3.0 * (cols - 80)) < 50, 2.0, 4.0).astype(np.float32)
        self.segment(DepthFrame(0, "", depth, Camera(160, 120, 140.0, 140.0, 79.5, 59.5)))

    def segment(self, frame: DepthFrame) -> Segmentation:
        """Label every pixel of the working grid."""
        found = self._finder.find(frame)
        labels = self._complete(found)
        is_person = (labels != BACKGROUND) & (labels != HIDDEN)
        return Segmentation(
            depth=np.where(is_person, found.depth, np.float32(0)),
            labels=labels,
            camera=found.camera,
            sightings=tuple(self._look_closer(found, labels, person) for person in found.people),
        )

    def _look_closer(self, found: Detections, labels: NDArray[np.uint8], person: Detection) -> Sighting:
        """Propose a person's joints from a crop around them."""
        seen = self._joints.find(found.depth, labels, found.camera, person.label, person.torso)
        return Sighting(
            label=person.label,
            place=person.torso,
            probability=person.probability,
            proposals=seen.joints.astype(np.float32),
            proposal_confidence=seen.confidence,
        )

    def _complete(self, found: Detections) -> NDArray[np.uint8]:
        """Add limbs that the net missed, drop flying pixels, mark what may hide more of people."""
        depth, camera, jump = found.depth, found.camera, self.config.depth_jump
        labels = found.labels.copy()
        if found.people:
            planes = self._planes.mark(camera.back_project(depth), camera)
            free = np.where(planes & (labels == BACKGROUND), np.float32(0), depth)
            limits = kernels.LimbLimits(jump, _LIMB_M2, _LIMB_WIDTH_M, _LIMB_CHANCE)
            kernels.attach_limbs(free, labels, found.chance, camera, limits)
        for label in range(1, int(labels.max()) + 1):
            own = labels == label
            kept = kernels.filter_support(depth, own, jump, self.config.min_support)
            labels[own & ~kept] = HIDDEN
        missing = depth == 0
        if missing.mean() < _CUT_AWAY:
            labels[missing] = HIDDEN
        kernels.mark_nearer(depth, labels, camera, jump)
        return labels


_LIMB_M2, _LIMB_WIDTH_M, _LIMB_CHANCE = 0.15, 0.13, 0.05
"""Most that the net misses of a person, square metres: an arm and a half, seen from the side; and the least
mean chance that the net gives such a part. By hand: of .02, .05 and .1 on the development clips."""

_CUT_AWAY = 0.5
"""Where more of an image is missing than this share, the background was cut away: it is free space."""
