"""Constants of the detection of people, chosen with the shipped weights."""

from __future__ import annotations

from typing import NamedTuple


class DetectTuning(NamedTuple):
    """Constants shared by the steps of the detection."""

    keep: float = 0.2
    """Minimum probability of a detection."""
    likely: float = 0.6
    """Probability from which a detection claims pixels around it."""
    sure: float = 0.9
    """Probability from which a detection is carried over, and no rotated image is tried."""
    find_every: int = 2
    """Interval between two searches of the image for people (frames), while all people are sure."""
    look_every: int = 2
    """Interval between two close looks at a person (frames), with more than two people."""
    depth_jump: float = 0.08
    """Depth step between neighbouring pixels of different surfaces (m)."""
    min_support: int = 7
    """A pixel is kept if this many of its 24 neighbours are on its surface."""
    min_height: float = 0.4
    """Minimum visible extent of a person, for the method of planes (m)."""
