"""What the steps hand to each other: depth frame, found person, match, and the skeleton that is published.

All of them are frozen and in SI units.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import Source


@dataclass(frozen=True)
class DepthFrame:
    """One depth image.

    Attributes
    ----------
    stamp_ns : int
        The sensor's time stamp, nanoseconds.
    frame_id : str
        Name of the optical frame.
    depth : (H, W) float32
        Distance along the optical axis, metres; 0 or NaN where nothing returned.
    camera : Camera
    filled : float
        Share of the image that the sensor sees; less than 1 where it was turned.
    """

    stamp_ns: int
    frame_id: str
    depth: NDArray[np.float32]
    camera: Camera
    filled: float = 1.0


BACKGROUND, PERSON, UNKNOWN = 0, 1, 2
"""What a pixel says of one person: free space; theirs; hidden by something nearer, or no return."""

HIDDEN = 255
"""Label in the cloud of everybody where something nearer than a person, or nothing, returned."""

MOST_LABEL = 254
"""Greatest number of a person in a cloud's labels; 0 is free space."""


@dataclass(frozen=True)
class FoundPerson:
    """Somebody whom a frame shows.

    Attributes
    ----------
    label : int
        Their number in the frame's labels, 1 to `MOST_LABEL`.
    body_id : str
        Stays the same while they are followed.
    probability : float
        That this is a person, 0 to 1, after all frames in which they were followed.
    proposals : (J, 3) float32
        Where the finder sees their joints (`JOINTS`), camera frame, metres;
        no rows where it does not say.
    proposal_confidence : (J,) float32
    """

    label: int
    body_id: str
    probability: float
    proposals: NDArray[np.float32]
    proposal_confidence: NDArray[np.float32]


@dataclass(frozen=True)
class Candidate:
    """One exemplar that may show the input's pose.

    Attributes
    ----------
    exemplar, view : int
        Row of the bank's poses, and the view of it that matched.
    rotation, translation : (3, 3), (3,) float64
        ``T_camera_model``: from the exemplar's model frame, *after* scaling, to the camera.
    distance : float
        Distance in the PCA subspace (eq. 6).
    score : float
        Rendered-depth disagreement with the input, 0 (same) to 1; lower is better.
    """

    exemplar: int
    view: int
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    distance: float
    score: float


@dataclass(frozen=True)
class PoseMatch:
    """The matcher's answer for one person, best candidate first.

    Attributes
    ----------
    body_id : str
    bank_id : str
        Content hash of the bank that the exemplar numbers refer to.
    scale : float
        The person's size relative to the bank's body.
    candidates : tuple of Candidate
    """

    body_id: str
    bank_id: str
    scale: float
    candidates: tuple[Candidate, ...]


BUILD_SIZE = 13
"""Numbers of a person's build: those of `depth_pose.body.build.BUILD_NAMES`."""


@dataclass(frozen=True)
class Skeleton:
    """One person's pose in one frame; with source LOST all arrays are empty (0 joints).

    Attributes
    ----------
    stamp_ns : int
    frame_id : str
    body_id : str
        Changes when the person changes.
    source : Source
    confidence : float
        0 to 1.
    residual : float
        Typical distance of the person's points from the fitted body, metres.
    scale : float
        The person's size relative to the bank's body.
    positions : (19, 3) float64
        Joint centres in the camera frame, metres.
    quats_xyzw : (19, 4) float64
        Rotation of the segment that begins at each joint, rest pose to camera frame.
    joint_confidence : (19,) float32
        0 to 1.
    joint_states : (19,) uint8
        `depth_pose.core.skeleton.JointState` values.
    build : (13,) float32
        The person's proportions (`depth_pose.body.build.BUILD_NAMES`); empty where they are not known.
    """

    stamp_ns: int
    frame_id: str
    body_id: str
    source: Source
    confidence: float
    residual: float
    scale: float
    positions: NDArray[np.float64]
    quats_xyzw: NDArray[np.float64]
    joint_confidence: NDArray[np.float32]
    joint_states: NDArray[np.uint8]
    build: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))

    @property
    def is_lost(self) -> bool:
        """Whether no pose is known."""
        return self.source == Source.LOST

    @classmethod
    def lost(cls, stamp_ns: int, frame_id: str, body_id: str = "") -> Skeleton:
        """Give the answer for a frame without a person."""
        return cls(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            body_id=body_id,
            source=Source.LOST,
            confidence=0.0,
            residual=0.0,
            scale=0.0,
            positions=np.zeros((0, 3)),
            quats_xyzw=np.zeros((0, 4)),
            joint_confidence=np.zeros(0, np.float32),
            joint_states=np.zeros(0, np.uint8),
        )
