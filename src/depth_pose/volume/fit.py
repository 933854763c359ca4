"""The final fit of a body to the volume, from the regressed pose.

Regression returns mixtures of training poses; only the volume shows how this dancer's arm differs from
them. The articulated fit of `depth_pose.refine.articulated`
is run on the surface voxels, with one change: the weight of a vertex is the probability that it is on
the surface, learned from the clothing in training. Parts hidden by clothing keep their regressed
pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.refine.articulated import articulate
from depth_pose.volume import _fit_kernels as kernels
from depth_pose.volume.tuning import VolumeFitTuning

Array = NDArray[np.float64]

_STIFFNESS: dict[str, float] = {
    "pelvis": 1.0,
    "spine": 1.0,
    "chest": 1.0,
    "clavicle": 3.0,
    "shoulder": 0.03,
    "elbow": 0.06,
    "hip": 0.5,
    "knee": 1.0,
    "ankle": 1.0,
}
"""Relative stiffness of each free node toward the start; nodes not named follow their parent. Arms are
visible in a volume, limbs under a skirt are not. Chosen like the defaults of `depth_pose.volume.config`."""


@dataclass(frozen=True)
class VolumeFit:
    """Result of the fit.

    Attributes
    ----------
    rotations, root
        The pose as in `depth_pose.body.pose.BodyPose`, in the world frame.
    residual : float
        Root mean square distance of trusted skin from the surface, metres.
    size : float
        Factor on the body's size that would reduce it.
    """

    rotations: Array
    root: Array
    residual: float
    size: float


class VolumeFitter:
    """Fits one body to volumes.

    Parameters
    ----------
    body : Body
    trust : (V,)
        Trust in each of its vertices, 0 to 1.
    tuning : VolumeFitTuning
    """

    def __init__(self, body: Body, trust: Array, tuning: VolumeFitTuning = VolumeFitTuning()) -> None:
        self.body, self.tuning = body, tuning
        self._articulation = articulate(body, _STIFFNESS)
        self._trust = np.ascontiguousarray(trust**self.tuning.trust_power)
        numbers = {n: float(getattr(tuning, n)) for n in kernels.Settings._fields if n != "sigmas"}
        self._settings = kernels.Settings(sigmas=np.array(self.tuning.sigmas), **numbers)

    def fit(
        self, surface: Array, rotations: Array, root: Array, stature: float, eyes: Array | None = None
    ) -> VolumeFit:
        """Fit the pose to surface voxels (N, 3), from a start; world frame, metres.

        ``eyes`` are the cameras' positions, (n, 3), if the surface is only the sides facing them.
        """
        every = max(1, -(-len(surface) // self.tuning.max_points))
        rotations, root = np.ascontiguousarray(rotations).copy(), np.array(root, np.float64)
        residual, size = kernels.fit_volume(
            np.ascontiguousarray(surface[::every]),
            np.zeros((0, 3)) if eyes is None else eyes,
            self._articulation,
            self._trust,
            self._settings,
            stature / self.body.stature,
            rotations,
            root,
        )
        return VolumeFit(rotations, root, float(residual), float(size))
