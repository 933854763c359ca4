"""Data of one person in one frame for the articulated fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.rendered_depth import Observation
from depth_pose.core.measurement import Proposals


class FitTarget(NamedTuple):
    """Data that a body is fitted to, prepared once for all fits of a frame.

    Attributes
    ----------
    points : (N, 3) float64
        The person's points in the camera frame, metres, in an order in which every third one
        still shows all of the person.
    full, coarse : Observation
        The same frame on the full grid, for free space, and on a coarse one, for visibility.
    nearest : (h, w, 2) int32
        Row and column of the nearest person pixel to every pixel of ``full``.
    proposals : Proposals
    floor : (4,) float64
        The floor's normal, upward, and the sensor's height above it, metres; 0 where it is unknown.
    noise : float
        Standard deviation of the points about the skin that does not average out over neighbouring points,
        metres, as measured in the frames before; 0 where it is unknown.
    """

    points: NDArray[np.float64]
    full: Observation
    coarse: Observation
    nearest: NDArray[np.int32]
    proposals: Proposals
    floor: NDArray[np.float64]
    noise: float = 0.0
