"""Detections in a frame, before ids are assigned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.measurement import JointMeasurement


@dataclass(frozen=True)
class Detection:
    """A person in a frame, without an id.

    Attributes
    ----------
    label : int
        Number in the frame's labels.
    place : (3,) float64
        Centre of the person, camera frame, metres.
    probability : float
        Probability of a person.
    measured : JointMeasurement or None
        None without a net that measures joints.
    is_calm : bool
        Whether hardly anything of the person has moved since they were measured.
    """

    label: int
    place: NDArray[np.float64]
    probability: float
    measured: JointMeasurement | None = None
    is_calm: bool = False


@dataclass(frozen=True)
class Segmentation:
    """The people in a frame, on the working grid.

    Attributes
    ----------
    depth : (h, w) float32
        Depth of people's pixels, metres; 0 elsewhere.
    labels : (h, w) uint8
        Number of each pixel's person, 0 for free space, or `depth_pose.core.labels.HIDDEN`.
    camera : Camera
        Camera of the working grid.
    detections : tuple of Detection
    out_of_range : int
        Number of people who are too near or too far.
    is_still : bool
        Whether the camera stands still, as far as is known.
    """

    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    camera: Camera
    detections: tuple[Detection, ...]
    out_of_range: int = 0
    is_still: bool = True


class Segmenter(Protocol):
    """A method of finding people (`depth_pose.core.config.SegmentConfig.method`)."""

    def reset(self) -> None:
        """Forget earlier frames."""

    def warm_up(self) -> None:
        """Compile every kernel."""

    def segment(self, frame: DepthFrame) -> Segmentation:
        """Find all people in a frame."""
