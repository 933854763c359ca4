"""A person found in a frame, as the stages hand them on."""

from __future__ import annotations

from dataclasses import dataclass

from depth_pose.core.measurement import JointMeasurement


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
    is_calm : bool
        Whether hardly anything of the person has moved since they were measured: then the earlier answers
        still hold, and no stage searches for others.
    """

    label: int
    body_id: str
    probability: float
    measured: JointMeasurement | None = None
    is_calm: bool = False
