"""Constants of the search in the exemplar bank, chosen with the default bank."""

from __future__ import annotations

from typing import NamedTuple


class MatchTuning(NamedTuple):
    """Constants of the matcher."""

    shortlist: int = 32
    """Number of exemplars nearest in the subspace that are compared, where no joints were measured."""
    keep: int = 3
    """Number of candidates for the refinement; 6 take .4 ms more and err as much."""
    keep_unmeasured: int = 6
    """The same without measured joints; 10 are not better."""
    search_every: int = 3
    """Interval between two searches for a person's exemplars (frames), once their size is known."""
    scale_frames: int = 10
    """Number of frames from which a person's size is estimated before it is held."""
