"""What a frame shows of people, before anybody has a name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.types import DepthFrame


@dataclass(frozen=True)
class Sighting:
    """Somebody in a frame who has no name yet.

    Attributes
    ----------
    label : int
        Their number in the frame's labels.
    place : (3,) float64
        Middle of the person, camera frame, metres.
    probability : float
        That it is a person.
    proposals : (J, 3) float32
        Where the finder sees their joints, camera frame, metres; no rows where it does not say.
    proposal_confidence : (J,) float32
    proposal_sigma : (J, 2) float32
        As in `depth_pose.core.types.FoundPerson`.
    is_news : bool
        Whether much of them was not there in the frame before, while the room was.
    """

    label: int
    place: NDArray[np.float64]
    probability: float
    proposals: NDArray[np.float32]
    proposal_confidence: NDArray[np.float32]
    proposal_sigma: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    is_news: bool = False


@dataclass(frozen=True)
class Segmentation:
    """Who a frame shows, on the working grid.

    Attributes
    ----------
    depth : (h, w) float32
        Depth of people's pixels, metres; 0 elsewhere.
    labels : (h, w) uint8
        Number of each pixel's person, 0 for free space, or `depth_pose.core.types.HIDDEN`.
    camera : Camera
        Camera of the working grid.
    sightings : tuple of Sighting
    out_of_range : int
        People seen who are too near or too far to be served.
    """

    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    camera: Camera
    sightings: tuple[Sighting, ...]
    out_of_range: int = 0


class Segmenter(Protocol):
    """A way to find people (`depth_pose.core.config.SegmentConfig.method`)."""

    def reset(self) -> None:
        """Forget earlier frames."""

    def warm_up(self) -> None:
        """Compile every kernel."""

    def segment(self, frame: DepthFrame) -> Segmentation:
        """Find everybody in a frame."""
