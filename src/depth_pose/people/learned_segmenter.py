"""Cut everybody out of a depth image with the learned people finder (the default)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.config import SegmentConfig
from depth_pose.core.types import BACKGROUND, HIDDEN, DepthFrame
from depth_pose.people import working_grid
from depth_pose.people.candidates import CandidateFinder
from depth_pose.people.finder import Detection, Detections
from depth_pose.people.joint_finder import JointFinder
from depth_pose.people.segmentation import Segmentation, Sighting


class LearnedSegmenter:
    """Finds everybody by two looks: at the image, and at each who may be a person.

    Parameters
    ----------
    config : SegmentConfig
    weights : path, optional
        A folder of nets in place of those that ship.
    """

    def __init__(self, config: SegmentConfig, weights: Path | None = None) -> None:
        self.config = config
        self._candidates = CandidateFinder(config, weights)
        self._joints = JointFinder(weights)

    def reset(self) -> None:
        """Forget the room."""
        self._candidates.reset()

    def warm_up(self) -> None:
        """Compile every kernel, and load the net."""
        working_grid.warm_up(self.config)
        rows, cols = np.mgrid[:120, :160]
        depth = np.where(np.hypot(rows - 60, 3.0 * (cols - 80)) < 50, 2.0, 4.0).astype(np.float32)
        self.segment(DepthFrame(0, "", depth, Camera(160, 120, 140.0, 140.0, 79.5, 59.5)))

    def segment(self, frame: DepthFrame) -> Segmentation:
        """Label every pixel of the working grid."""
        found, labels = self._candidates.find(frame)
        sightings = [self._look_closer(found, labels, person) for person in found.people]
        sure = tuple(s for s in sightings if s.probability >= self.config.keep)
        for thing in sightings:
            if thing.probability < self.config.keep:
                labels[labels == thing.label] = BACKGROUND
        is_person = (labels != BACKGROUND) & (labels != HIDDEN)
        return Segmentation(
            depth=np.where(is_person, found.depth, np.float32(0)),
            labels=labels,
            camera=found.camera,
            sightings=sure,
            out_of_range=found.out_of_range,
        )

    def _look_closer(self, found: Detections, labels: NDArray[np.uint8], person: Detection) -> Sighting:
        """Propose a person's joints from a crop around them, and say whether it is one."""
        seen = self._joints.find(
            found.depth, labels, found.camera, person.label, person.torso, person.probability
        )
        return Sighting(
            label=person.label,
            place=person.torso,
            probability=seen.probability,
            proposals=seen.joints.astype(np.float32),
            proposal_confidence=seen.confidence,
        )
