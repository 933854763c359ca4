"""Exemplars of a bank that may show a person's pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
