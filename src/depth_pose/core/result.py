"""The published result: one person's skeleton in one frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.boxes import box_2d, box_3d
from depth_pose.core.camera import Camera, Lens
from depth_pose.core.joint import Joint
from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointName, JointState, Source, Tracking
from depth_pose.core.sketch import html, plot
from depth_pose.core.tables import to_dict, to_pandas, to_record

BUILD_SIZE = 13
"""Length of a person's build vector, as `depth_pose.body.build.BUILD_NAMES`."""


_TRUNK = [JOINT_INDEX[name] for name in ("pelvis", "spine", "chest")]
"""Joints whose mean is the centre of a person."""


@dataclass(frozen=True, eq=False, repr=False)
class Skeleton:
    """One person's pose in one frame; with source LOST all arrays are empty (0 joints).

    ``skeleton["left_wrist"]`` is one `Joint`; ``skeleton.positions`` are all of them, in the order of
    `depth_pose.JOINTS`. Skeletons are equal where all of their values are.

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
    velocities : (19, 3) float64
        Joint velocities, camera frame, m/s; empty where they are unknown, as in the first frame of a person.
    covariances : (19, 3, 3) float64
        Covariance of each position, camera frame, m^2; empty where it is unknown.
    tracking : Tracking
        NEW in the first frame of a person and after a gap, then TRACKED; LOST without a pose.

    Examples
    --------
    >>> import numpy as np
    >>> person = Skeleton(
    ...     stamp_ns=40_000_000, frame_id="camera", body_id="body_1", source=Source.REFINED, confidence=0.9,
    ...     residual=0.01, scale=1.0, positions=np.zeros((19, 3)), quats_xyzw=np.zeros((19, 4)),
    ...     joint_confidence=np.ones(19, np.float32), joint_states=np.zeros(19, np.uint8),
    ... )
    >>> person
    <Skeleton body_1 at 0.040 s: REFINED, confidence 0.90, centre (0.00, 0.00, 0.00) m, 19 of 19 joints seen>
    >>> person["left_wrist"].position
    array([0., 0., 0.])
    >>> person["left_wrist"].state.name
    'SEEN'
    >>> "left_wrist" in person, len(person), [joint.name for joint in person][:2]
    (True, 19, ['pelvis', 'spine'])
    >>> sorted(person.to_dict())[:4]
    ['body_id', 'box', 'centre', 'confidence']
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
    velocities: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3, 3)))
    tracking: Tracking = Tracking.UNKNOWN

    # --- one joint, or all

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

    def __getitem__(self, name: JointName) -> Joint:
        if name not in JOINT_INDEX:
            raise KeyError(f"there is no joint {name!r}; the joints are {', '.join(JOINTS)}")
        if self.is_lost:
            raise KeyError(f"there is no {name}: the skeleton is LOST and has no joints")
        return self._joint(JOINT_INDEX[name])

    def __contains__(self, name: object) -> bool:
        """Whether there is a joint with this name."""
        return name in JOINT_INDEX and not self.is_lost

    def __iter__(self) -> Iterator[Joint]:
        """Yield all joints, in the order of `JOINTS`."""
        return iter(self.joints)

    def __len__(self) -> int:
        """Return the number of joints: 19, or 0 where the skeleton is lost."""
        return len(self.positions)

    def __bool__(self) -> bool:
        """Return whether a pose is known."""
        return not self.is_lost

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Skeleton):
            return NotImplemented
        return all(_is_same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))

    def __hash__(self) -> int:
        return hash((self.stamp_ns, self.frame_id, self.body_id, self.source))

    def __repr__(self) -> str:
        start = f"<Skeleton {self.body_id or 'of nobody'} at {self.time:.3f} s: {Source(self.source).name}"
        if self.is_lost:
            return f"{start}>"
        x, y, z = self.centre
        seen = int((self.joint_states == JointState.SEEN).sum())
        return (
            f"{start}, confidence {self.confidence:.2f}, centre ({x:.2f}, {y:.2f}, {z:.2f}) m, "
            f"{seen} of {len(self)} joints seen>"
        )

    def _joint(self, index: int) -> Joint:
        has_motion, has_spread = len(self.velocities) > 0, len(self.covariances) > 0
        return Joint(
            JOINTS[index],
            self.positions[index],
            self.quats_xyzw[index],
            float(self.joint_confidence[index]),
            JointState(self.joint_states[index]),
            self.velocities[index] if has_motion else np.full(3, np.nan),
            self.covariances[index] if has_spread else np.full((3, 3), np.nan),
        )

    # --- the person as a whole

    @property
    def centre(self) -> NDArray[np.float64]:
        """Centre of the trunk (3,), camera frame, metres; NaN where the skeleton is lost."""
        return np.full(3, np.nan) if self.is_lost else self.positions[_TRUNK].mean(axis=0)

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity of the trunk (3,), camera frame, m/s; NaN where it is unknown."""
        return self.velocities[_TRUNK].mean(axis=0) if len(self.velocities) else np.full(3, np.nan)

    @property
    def box(self) -> NDArray[np.float64]:
        """Corners (2, 3) with the least and the greatest coordinates, camera frame, metres.

        It is estimated from the joints, with flesh around them; NaN where the skeleton is lost.
        """
        return np.full((2, 3), np.nan) if self.is_lost else box_3d(self.positions, self.scale)

    def box_in(self, camera: Camera | Lens) -> NDArray[np.float64]:
        """Return left, top, right and bottom (4,) in a camera's image, pixels, clipped to the image.

        NaN where the person is outside of the image, or lost.
        """
        return np.full(4, np.nan) if self.is_lost else box_2d(self.positions, self.scale, camera)

    def pixels(self, camera: Camera | Lens) -> NDArray[np.float64]:
        """Return the joints' column and row (19, 2) in a camera's image, pixels; some may be outside."""
        return camera.project(self.positions)

    # --- other forms

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, strings and lists, suitable for JSON; joints by their names.

        What is unknown is None.
        """
        return to_dict(self)

    def to_record(self) -> NDArray[np.void]:
        """Return one row of type `depth_pose.core.tables.RECORD`; NaN where something is unknown."""
        return to_record(self)

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with a row for each joint.

        Its columns are those of the CSV export, without ``frame``: stamp_ns, time_s, body_id, joint, x, y, z,
        qx, qy, qz, qw, joint_confidence, joint_state, confidence, source, scale, frame_id.

        Raises
        ------
        ConfigError
            Where pandas is not installed.
        """
        return to_pandas([self])

    def plot(self, axes: Any = None) -> Any:
        """Draw the skeleton with matplotlib, seen from the camera and from the side; return the axes.

        Parameters
        ----------
        axes : matplotlib axes in 3D, optional
            New ones by default.

        Raises
        ------
        ConfigError
            Where matplotlib is not installed.
        """
        return plot([self.positions], axes)

    def _repr_html_(self) -> str:
        """Return a picture and one line, for notebooks."""
        return html([(self.positions, self.joint_confidence)], repr(self))

    # --- the same pose elsewhere

    def at(self, stamp_ns: int) -> Skeleton:
        """Return the same pose at another time."""
        return replace(self, stamp_ns=stamp_ns)

    def turned(
        self, rotation: NDArray[np.float64], translation: NDArray[np.float64], frame_id: str
    ) -> Skeleton:
        """Return the same pose in another frame.

        Parameters
        ----------
        rotation, translation : (3, 3), (3,) float64
            From the skeleton's frame to the other one, metres.
        frame_id : str
            Name of the other frame.
        """
        return replace(
            self,
            frame_id=frame_id,
            positions=self.positions @ rotation.T + translation,
            quats_xyzw=matrix_to_quat(rotation @ quat_to_matrix(self.quats_xyzw)).reshape(-1, 4),
            velocities=self.velocities @ rotation.T,
            covariances=rotation @ self.covariances @ rotation.T,
        )

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
            tracking=Tracking.LOST,
        )


def _is_same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(a == b)
