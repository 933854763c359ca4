"""Constants of failure detection and temporal registration (Ye et al., Sec. 6)."""

from __future__ import annotations

from typing import NamedTuple


class RecoverTuning(NamedTuple):
    """Constants of the failure check."""

    enabled: bool = True
    """Failures are looked for and recovered from."""
    bone_change: float = 0.25
    """Relative change of a bone's length between frames that is a failure."""
    angle_excess: float = 60.0
    """Angle beyond a joint's limit that is a failure (degrees)."""
    joint_speed: float = 6.0
    """Speed of a joint above which it jumped (m/s)."""
    score_rise: float = 0.06
    """Sudden rise of the rendered-depth disagreement, 0 to 1, that is a failure."""


class TemporalTuning(NamedTuple):
    """Constants of the registration of one frame's cloud to the next.

    The field is less stiff than from exemplar to input: both clouds show the same person.
    """

    beta: float = 0.5
    """Width of the coherence kernel (m)."""
    stiffness: float = 4.0
    """Weight lambda of the coherence."""
    reach: float = 0.05
    """A vertex moves with the points of its own frame within this distance, near ones more (m)."""
