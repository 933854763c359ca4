"""From a depth image to everybody's clean points: finding people, then denoising (Sec. 4)."""

from __future__ import annotations

import numpy as np

from depth_pose.core.camera import Camera
from depth_pose.core.config import DenoiseConfig, SegmentConfig
from depth_pose.core.stamps import StampGuard
from depth_pose.core.types import HIDDEN, DepthFrame, FoundPerson
from depth_pose.people import _segment_kernels as kernels
from depth_pose.people.person import People, see_people
from depth_pose.people.plane_segmenter import PersonSegmenter
from depth_pose.people.tracks import PeopleTracks
from depth_pose.steps.denoise import denoise_depth

_NO_PROPOSALS = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)


class PeopleExtractor:
    """The first stage: what `denoise_node` runs."""

    def __init__(self, segment: SegmentConfig, denoise: DenoiseConfig) -> None:
        self._segmenter = PersonSegmenter(segment)
        self._denoise = denoise
        self._tracks = PeopleTracks(start=0.6, keep=0.3)
        self._guard = StampGuard()

    def reset(self) -> None:
        """Forget the people."""
        self._segmenter.reset()
        self._tracks.reset()

    def warm_up(self) -> None:
        """Compile every kernel on a small synthetic frame."""
        depth = np.full((48, 64), 3.0, np.float32)
        depth[8:40, 20:44] = 2.0
        frame = DepthFrame(0, "", depth, Camera(64, 48, 60.0, 60.0, 31.5, 23.5))
        PeopleExtractor(self._segmenter.config, self._denoise).extract(frame)
        kernels.reduce_depth(np.ones((4, 4), np.float32), 2, 0.1, 0.4, 8.0)

    def extract(self, frame: DepthFrame) -> People:
        """Find the people, name them, and denoise their points."""
        if self._guard.is_break(frame.stamp_ns):
            self.reset()
        seen = self._segmenter.segment(frame)
        depth = denoise_depth(seen.depth, seen.camera, self._denoise)
        labels = np.where((seen.depth > 0) & (depth <= 0), np.uint8(HIDDEN), seen.labels)
        names = self._tracks.assign(seen.sightings, frame.stamp_ns)
        found = (
            FoundPerson(k + 1, name, seen.sightings[k].probability, *_NO_PROPOSALS)
            for k, name in enumerate(names)
            if name is not None
        )
        points = seen.camera.back_project(depth)
        return see_people(frame.stamp_ns, frame.frame_id, seen.camera, points, labels, found)
