"""From a depth image to the person's clean points: segmentation, then denoising (Sec. 4)."""

from __future__ import annotations

import numpy as np

from depth_pose.core.camera import Camera
from depth_pose.core.config import DenoiseConfig, SegmentConfig
from depth_pose.core.stamps import StampGuard
from depth_pose.core.types import PERSON, UNKNOWN, DepthFrame, PersonCloud
from depth_pose.people import _segment_kernels as kernels
from depth_pose.people.plane_segmenter import PersonSegmenter
from depth_pose.steps.denoise import denoise_depth


class PersonExtractor:
    """The first stage: what `denoise_node` runs."""

    def __init__(self, segment: SegmentConfig, denoise: DenoiseConfig) -> None:
        self._segmenter = PersonSegmenter(segment)
        self._denoise = denoise
        self._guard = StampGuard()

    def reset(self) -> None:
        """Forget the person."""
        self._segmenter.reset()

    def warm_up(self) -> None:
        """Compile every kernel on a small synthetic frame."""
        depth = np.full((48, 64), 3.0, np.float32)
        depth[8:40, 20:44] = 2.0
        frame = DepthFrame(0, "", depth, Camera(64, 48, 60.0, 60.0, 31.5, 23.5))
        PersonExtractor(self._segmenter.config, self._denoise).extract(frame)
        kernels.reduce_depth(np.ones((4, 4), np.float32), 2, 0.1, 0.4, 8.0)

    def extract(self, frame: DepthFrame) -> PersonCloud:
        """Find the person and denoise their points.

        Returns
        -------
        PersonCloud
            Without any valid point where nobody is in view.
        """
        if self._guard.is_break(frame.stamp_ns):
            self.reset()
        person = self._segmenter.segment(frame)
        depth = denoise_depth(person.depth, person.camera, self._denoise)
        labels = person.labels.copy()
        labels[(labels == PERSON) & (depth <= 0)] = UNKNOWN
        camera = person.camera
        points = camera.back_project(depth)
        return PersonCloud(frame.stamp_ns, frame.frame_id, points, labels)
