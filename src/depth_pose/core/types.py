"""Data passed between the steps: depth frame, found person, match, and the published skeleton.

All of them are frozen and in SI units.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.extras import require
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointState, Source


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
        Share of the image that the sensor sees; less than 1 where it was rotated.
    in_view : float
        Share of a point cloud's points that lie in view of the camera; 1 of an image.

    Raises
    ------
    InputError
        Where depth is not float32, or not of the camera's size.
    """

    stamp_ns: int
    frame_id: str
    depth: NDArray[np.float32]
    camera: Camera
    filled: float = 1.0
    in_view: float = 1.0

    def __post_init__(self) -> None:
        if self.depth.dtype != np.float32:
            raise InputError(f"depth has dtype {self.depth.dtype}; a DepthFrame has float32 metres")
        if self.depth.shape != (self.camera.height, self.camera.width):
            raise InputError(
                f"depth has shape {self.depth.shape}, the camera's image "
                f"{(self.camera.height, self.camera.width)}: rows, columns"
            )


BACKGROUND, PERSON, UNKNOWN = 0, 1, 2
"""State of a pixel for one person: free space; the person; hidden by something nearer, or no return."""

HIDDEN = 255
"""Label in the cloud of all people where something nearer than a person, or nothing, returned."""

MOST_LABEL = 254
"""Largest number of a person in a cloud's labels; 0 is free space."""


@dataclass(frozen=True)
class TrackedPerson:
    """A person found in a frame.

    Attributes
    ----------
    label : int
        Their number in the frame's labels, 1 to `MOST_LABEL`.
    body_id : str
        Stays the same while they are followed.
    probability : float
        Probability that this is a person, 0 to 1, over all frames in which they were followed.
    measured : JointMeasurement or None
        Their joints, as the joint net measured them; None without.
    """

    label: int
    body_id: str
    probability: float
    measured: JointMeasurement | None = None


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
    """The matcher's result for one person, best candidate first.

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
"""Length of a person's build vector, as `depth_pose.body.build.BUILD_NAMES`."""


class Joint(NamedTuple):
    """One joint of a skeleton.

    Attributes
    ----------
    name : str
        One of `depth_pose.JOINTS`.
    position : (3,) float64
        Centre of rotation in the camera frame (x right, y down, z forward), metres.
    quat_xyzw : (4,) float64
        Rotation of the segment that begins at the joint, rest pose to camera frame.
    confidence : float
        Probability that the position is within 10 cm, 0 to 1.
    state : JointState
        SEEN, OCCLUDED, OUTSIDE_IMAGE or LOST.
    """

    name: str
    position: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    confidence: float
    state: JointState


RECORD = np.dtype(
    [
        ("stamp_ns", "i8"),
        ("id", "U32"),
        ("source", "U9"),
        ("confidence", "f4"),
        ("residual", "f4"),
        ("scale", "f4"),
        ("positions", "f8", (len(JOINTS), 3)),
        ("quats_xyzw", "f8", (len(JOINTS), 4)),
        ("joint_confidence", "f4", (len(JOINTS),)),
        ("joint_states", "u1", (len(JOINTS),)),
    ]
)
"""Type of `Skeleton.to_record`; rows of ``positions`` and the like are in the order of `JOINTS`."""


@dataclass(frozen=True)
class Skeleton:
    """One person's pose in one frame; with source LOST all arrays are empty (0 joints).

    ``skeleton["left_wrist"]`` is one `Joint`; ``skeleton.positions`` are all of them, in the order of
    `depth_pose.JOINTS`.

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
    alternative : Skeleton or None
        The same person facing the other way, where left and right cannot be told; its confidences are lower
        by the probability of that.

    Examples
    --------
    >>> import numpy as np
    >>> person = Skeleton(
    ...     stamp_ns=40_000_000, frame_id="camera", body_id="body_1", source=Source.REFINED, confidence=0.9,
    ...     residual=0.01, scale=1.0, positions=np.zeros((19, 3)), quats_xyzw=np.zeros((19, 4)),
    ...     joint_confidence=np.ones(19, np.float32), joint_states=np.zeros(19, np.uint8),
    ... )
    >>> person.id, person.time
    ('body_1', 0.04)
    >>> person["left_wrist"].position
    array([0., 0., 0.])
    >>> person["left_wrist"].state.name
    'SEEN'
    >>> sorted(person.to_dict())
    ['confidence', 'frame_id', 'id', 'joints', 'residual', 'scale', 'source', 'stamp_ns', 'time']
    >>> np.stack([person.to_record(), person.to_record()])["positions"].shape
    (2, 19, 3)
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
    alternative: Skeleton | None = None

    @property
    def id(self) -> str:
        """The person's name: ``body_id``."""
        return self.body_id

    @property
    def time(self) -> float:
        """The stamp, seconds."""
        return self.stamp_ns * 1e-9

    @property
    def joints(self) -> tuple[Joint, ...]:
        """All joints, in the order of `JOINTS`; none where the skeleton is lost."""
        return tuple(self._joint(i) for i in range(len(self.positions)))

    def __getitem__(self, name: str) -> Joint:
        if name not in JOINT_INDEX:
            raise KeyError(f"there is no joint {name!r}; the joints are {', '.join(JOINTS)}")
        if self.is_lost:
            raise KeyError(f"there is no {name}: the skeleton is LOST and has no joints")
        return self._joint(JOINT_INDEX[name])

    def _joint(self, index: int) -> Joint:
        return Joint(
            JOINTS[index],
            self.positions[index],
            self.quats_xyzw[index],
            float(self.joint_confidence[index]),
            JointState(self.joint_states[index]),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, strings and lists, suitable for JSON; joints by their names.

        An `alternative` is included where there is one.
        """
        other = {} if self.alternative is None else {"alternative": self.alternative.to_dict()}
        return other | {
            "id": self.body_id,
            "time": self.time,
            "stamp_ns": self.stamp_ns,
            "frame_id": self.frame_id,
            "source": Source(self.source).name,
            "confidence": float(self.confidence),
            "residual": float(self.residual),
            "scale": float(self.scale),
            "joints": {
                joint.name: {
                    "position": joint.position.tolist(),
                    "quat_xyzw": joint.quat_xyzw.tolist(),
                    "confidence": joint.confidence,
                    "state": joint.state.name,
                }
                for joint in self.joints
            },
        }

    def to_record(self) -> NDArray[np.void]:
        """Return one row of a NumPy table, of type `RECORD`; NaN where the skeleton is lost."""
        record = np.zeros((), RECORD)
        for name in ("stamp_ns", "confidence", "residual", "scale"):
            record[name] = getattr(self, name)
        record["id"], record["source"] = self.body_id, Source(self.source).name
        record["joint_states"] = JointState.LOST if self.is_lost else self.joint_states
        for name in ("positions", "quats_xyzw", "joint_confidence"):
            record[name] = np.nan if self.is_lost else getattr(self, name)
        return record

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with a row for each joint.

        Its columns are time, id, joint, x, y, z, confidence and state.

        Raises
        ------
        ConfigError
            Where pandas is not installed.
        """
        require("pandas", "to_pandas")
        import pandas

        x, y, z = self.positions.T
        return pandas.DataFrame(
            {
                "time": self.time,
                "id": self.body_id,
                "joint": [joint.name for joint in self.joints],
                "x": x,
                "y": y,
                "z": z,
                "confidence": self.joint_confidence,
                "state": [joint.state.name for joint in self.joints],
            }
        )

    def at(self, stamp_ns: int) -> Skeleton:
        """Return the same pose at another time."""
        other = None if self.alternative is None else self.alternative.at(stamp_ns)
        return replace(self, stamp_ns=stamp_ns, alternative=other)

    @property
    def is_lost(self) -> bool:
        """Whether no pose is known."""
        return self.source == Source.LOST

    @classmethod
    def lost(cls, stamp_ns: int, frame_id: str, body_id: str = "") -> Skeleton:
        """Return the skeleton for a frame without a person."""
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


def alternatives_of(skeletons: Iterable[Skeleton]) -> tuple[Skeleton, ...]:
    """Return the second answers of those skeletons that have one."""
    return tuple(s.alternative for s in skeletons if s.alternative is not None)
