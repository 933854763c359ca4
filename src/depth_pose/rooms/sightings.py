"""One camera's view of a person, in the room's frame: z up, the floor at z = 0, metres."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointState

TRUNK: NDArray[np.int64] = np.array(
    [
        JOINT_INDEX[name]
        for name in (
            *("pelvis", "spine", "chest", "neck"),
            *("left_shoulder", "right_shoulder", "left_hip", "right_hip"),
        )
    ]
)
"""Joints that define a person's position."""

_KNOWN = 0.3
"""Minimum confidence of a joint that is compared; set by hand."""

_ENOUGH = 2
"""Minimum number of known joints for a comparison; set by hand."""


@dataclass(frozen=True, eq=False)
class RoomSighting:
    """One person in one frame of one camera.

    Attributes
    ----------
    body_id : str
        The camera's own id of the person.
    joints : (19, 3) float64
        Room frame, metres.
    joint_confidence : (19,) float
        0 to 1.
    joint_states : (19,) uint8
        `depth_pose.core.skeleton.JointState` values.
    confidence : float
        Of the skeleton, 0 to 1.
    scale : float
        Size relative to the bank's body; 0 where it is not known.
    build : (13,) float32
        Proportions (`depth_pose.body.build.BUILD_NAMES`); empty where they are not known.
    skeleton : Skeleton or None
        The skeleton that it was made from.
    """

    body_id: str
    joints: NDArray[np.float64]
    joint_confidence: NDArray[np.floating]
    joint_states: NDArray[np.uint8]
    confidence: float = 1.0
    scale: float = 1.0
    build: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    skeleton: Skeleton | None = None

    @classmethod
    def of(cls, skeleton: Skeleton) -> RoomSighting:
        """Make one from a skeleton in the room's frame that is not lost."""
        return cls(
            skeleton.body_id,
            skeleton.positions,
            skeleton.joint_confidence,
            skeleton.joint_states,
            skeleton.confidence,
            skeleton.scale,
            skeleton.build,
            skeleton,
        )

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask of the joints (19,) that can be compared."""
        return (self.joint_states != JointState.LOST) & (self.joint_confidence >= _KNOWN)

    def shift_to(self, other: RoomSighting) -> NDArray[np.float64]:
        """Return the median displacement (3,), metres, of the trunk from this sighting to another.

        Only joints known in both count: those of the trunk, or all where too few of it are known.
        """
        return np.asarray(np.median((other.joints - self.joints)[self._common(other)], axis=0))

    def distance(self, other: RoomSighting, offset: NDArray[np.float64]) -> float:
        """Return the median horizontal distance (m) of the joints known in both, `other` moved by an offset.

        Parameters
        ----------
        other : RoomSighting
        offset : (3,) float64
            Metres.
        """
        ways = (other.joints + offset - self.joints)[self._common(other), :2]
        return float(np.median(np.hypot(*ways.T)))

    def _common(self, other: RoomSighting) -> NDArray[np.int64]:
        both = self.known & other.known
        trunk = TRUNK[both[TRUNK]]
        if len(trunk) >= _ENOUGH:
            return trunk
        return np.flatnonzero(both) if both.sum() >= _ENOUGH else np.arange(len(JOINTS))
