"""A last fit of a body to the volume, from the regressed pose.

Regression answers with mixtures of poses that it was taught; only the volume itself tells how this
dancer's arm differs from all of them. The articulated fit of `depth_pose.fit.articulated`
is run on the surface voxels, with one change: a vertex counts as much as it can be trusted to lie on
the surface, which was learned from the training's clothing. What clothing hides keeps its regressed
pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.normals import vertex_normals
from depth_pose.core.skeleton import NODE_INDEX, NODE_PARENTS, NODES
from depth_pose.fit.articulated import parameters_above
from depth_pose.volume import _fit_kernels as kernels
from depth_pose.volume.config import VolumeFitConfig

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
"""Relative stiffness of each free node toward the start; nodes not named follow their parent. Arms show in a
volume, what a skirt hides does not. Chosen like the defaults of `depth_pose.volume.config`."""


@dataclass(frozen=True)
class VolumeFit:
    """What the fit found.

    Attributes
    ----------
    rotations : (21, 3, 3) float64
        Segment rotations, rest pose to world frame.
    root : (3,) float64
        Pelvis, metres.
    residual : float
        Root mean square distance of trusted skin from the surface, metres.
    size : float
        Factor on the body's size that would bring them nearer.
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
        Of each of its vertices, 0 to 1.
    config : VolumeFitConfig
    """

    def __init__(self, body: Body, trust: Array, config: VolumeFitConfig | None = None) -> None:
        self.body, self.config = body, config or VolumeFitConfig()
        sparse = body.sparse_weights
        self._influence, self._weight = sparse.nodes, sparse.weights
        self._normals = vertex_normals(body)
        self._trust = np.ascontiguousarray(trust**self.config.trust_power)
        self._free = np.full(len(NODES), -1)
        stiffness: list[float] = []
        for name, node in NODE_INDEX.items():
            kind = name.split("_")[-1]
            if kind in _STIFFNESS:
                self._free[node] = len(stiffness)
                stiffness.append(_STIFFNESS[kind])
        self._stiffness = np.array(stiffness)
        self._above = parameters_above(self._free)

    def fit(
        self, surface: Array, rotations: Array, root: Array, stature: float, eyes: Array | None = None
    ) -> VolumeFit:
        """Fit the pose to surface voxels (N, 3), from a start; world frame, metres.

        ``eyes`` is where the cameras stand, (n, 3), if the surface is only the sides that they see.
        """
        c = self.config
        every = max(1, -(-len(surface) // c.max_points))
        rotations, root = np.ascontiguousarray(rotations).copy(), np.array(root, np.float64)
        residual, size = kernels.fit_volume(
            np.ascontiguousarray(surface[::every]), np.array(c.sigmas),
            self.body.vertices, self._normals, self._influence, self._weight, self.body.nodes,
            NODE_PARENTS, self._free, self._above, self._stiffness, stature / self.body.stature, self._trust,
            np.zeros((0, 3)) if eyes is None else eyes,
            (c.outlier, c.plane_weight, c.point_weight, c.prior, c.root_prior, c.damping, c.max_step),
            rotations, root,
        )  # fmt: skip
        return VolumeFit(rotations, root, float(residual), float(size))
