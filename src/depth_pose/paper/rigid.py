r"""Least-squares rigid transforms, and transfer of joints by control vertices (Ye et al. eq. 8).

The transform that minimises :math:`\sum_i w_i \|R q_i + t - \hat q_i\|^2` is found from the singular value
decomposition of the weighted covariance (W. Kabsch, Acta Cryst. A 32, 1976; S. Umeyama, IEEE TPAMI 13, 1991,
for the proper rotation in degenerate cases). The paper iterates closest points; here the deformed mesh has
the exemplar's vertices, so the correspondences are known and one step is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.core.skeleton import NODE_PARENTS, NODES

Array = NDArray[np.float64]

_REACH = {"pelvis": 0.11, "spine": 0.10, "chest": 0.11, "neck": 0.07, "head": 0.08, "clavicle": 0.08,
          "shoulder": 0.07, "elbow": 0.05, "wrist": 0.045, "hip": 0.09, "knee": 0.065, "ankle": 0.05,
          "foot": 0.04}  # fmt: skip
"""Width of the Gaussian that weights a joint's control vertices (m on a body of 1.75 m); set by hand to
about the limb's half width."""

_TAIL = 0.05
"""Control vertices below this share of the largest weight are dropped, for speed."""


@dataclass(frozen=True)
class RigidTransform:
    """Rotations (..., 3, 3) and translations (..., 3): ``x -> R x + t``."""

    rotation: Array
    translation: Array

    def apply(self, points: Array) -> Array:
        """Transform one point by each transform, (..., 3) to (..., 3)."""
        return np.asarray(np.einsum("...ij,...j->...i", self.rotation, points) + self.translation)


def fit_rigid(source: Array, target: Array, weights: Array) -> RigidTransform:
    """Find the least-squares rigid transforms from source points to target points: Ye et al. eq. 8.

    Parameters
    ----------
    source, target : (M, 3) float64
        Corresponding points, metres.
    weights : (..., M) float64
        Weights, not negative and not all 0; one transform for each leading index.

    Returns
    -------
    RigidTransform
        With a singular covariance (points on a line) any of the best is returned.
    """
    share = weights / weights.sum(axis=-1, keepdims=True)
    mean_s, mean_t = share @ source, share @ target
    products = (target[:, :, None] * source[:, None, :]).reshape(len(source), 9)
    second = (share @ products).reshape(*share.shape[:-1], 3, 3)
    # Ye et al. eq. 8: the best rotation, from the singular vectors of the covariance
    u, _, vt = np.linalg.svd(second - mean_t[..., :, None] * mean_s[..., None, :])
    u[..., :, 2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))[..., None]
    rotation = u @ vt
    return RigidTransform(rotation, mean_t - np.einsum("...ij,...j->...i", rotation, mean_s))


class JointTransfer:
    """Transfers a body's joints from a posed mesh to a deformed one by control vertices.

    A joint's place is transferred by nearby vertices whose skin weights belong to the two segments that meet
    there, and a segment's rotation by the vertices that move with it.
    """

    def __init__(self, body: Body) -> None:
        size = body.stature / 1.75
        count = len(NODES)
        near = np.empty((count, len(body.vertices)))
        for n, name in enumerate(NODES):
            joins = [n] + ([int(NODE_PARENTS[n])] if n else []) + np.flatnonzero(n == NODE_PARENTS).tolist()
            reach = _REACH[name.split("_")[-1]] * size
            squared = ((body.vertices - body.nodes[n]) ** 2).sum(axis=1)
            near[n] = np.exp(-0.5 * squared / reach**2) * body.weights[:, joins].sum(axis=1)
        segment = body.weights.copy()
        for n, name in enumerate(NODES):
            if name.endswith("foot"):  # the feet take the rotation of their ankle
                ankle = NODE_PARENTS[n]
                segment[:, ankle] = segment[:, n] = body.weights[:, ankle] + body.weights[:, n]
        for n in range(1, count):
            if not segment[:, n].any():  # no vertex moves with it: it rotates with its parent
                segment[:, n] = segment[:, NODE_PARENTS[n]]
        self._place, self._segment = _trim(near), _trim(segment.T)

    def transfer(self, posed: Array, nodes: Array, rotations: Array, deformed: Array) -> tuple[Array, Array]:
        """Transfer nodes and segment rotations (Ye et al. eq. 8).

        Parameters
        ----------
        posed, deformed : (V, 3) float64
            The mesh before and after, metres.
        nodes : (21, 3) float64
            Nodes of the posed mesh, metres.
        rotations : (21, 3, 3) float64
            Its segment rotations.

        Returns
        -------
        nodes : (21, 3) float64
        rotations : (21, 3, 3) float64
        """
        moved = fit_rigid(posed, deformed, self._place).apply(nodes)
        turns = fit_rigid(posed, deformed, self._segment).rotation
        return moved, turns @ rotations


def _trim(weights: Array) -> Array:
    """Set weights below a share of the greatest to 0."""
    return np.where(weights < _TAIL * weights.max(axis=1, keepdims=True), 0.0, weights)
