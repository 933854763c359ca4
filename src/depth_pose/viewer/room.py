"""The floor of the scene, estimated from the first frames with a person standing on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.result import Skeleton
from depth_pose.detect.floor import Floor
from depth_pose.export.floor import floor_of_depth, floor_of_feet
from depth_pose.export.tracks import tracks_of
from depth_pose.viewer.frames import ViewerFrame

_FRAMES = 15
"""Number of frames with people used to estimate the floor; feet move little in fewer."""
_LOOKS = 3 * _FRAMES
"""Number of frames after which the available ones are used: a short looping recording has no others."""
_IMAGES = 6
"""Number of depth images kept to find the floor."""


class FloorSeeker:
    """Collects frames until the floor is found."""

    def __init__(self) -> None:
        self._people: dict[int, tuple[Skeleton, ...]] = {}
        self._images: list[DepthFrame] = []
        self._looks = 0
        self.floor: Floor | None = None

    def add(self, frame: ViewerFrame) -> NDArray[np.float64] | None:
        """Add a frame; return ``T_world_camera`` once, when the floor is found."""
        if self.floor is not None or not frame.skeletons:
            return None
        self._looks += 1
        if len(self._images) < _IMAGES and frame.stamp_ns not in self._people:
            depth = frame.depth_mm.astype(np.float32) * np.float32(1e-3)
            self._images.append(DepthFrame(frame.stamp_ns, "", depth, frame.camera))
        self._people[frame.stamp_ns] = frame.skeletons
        if len(self._people) < _FRAMES and self._looks < _LOOKS:
            return None
        try:
            guess = floor_of_feet(tracks_of(self._people, "").people)
        except InputError:  # no feet so far
            self._people.clear()
            self._images.clear()
            self._looks = 0
            return None
        self.floor = floor_of_depth(self._images, guess) or guess
        return self.floor.T_floor_camera
