r"""Articulated fit: the pose of a skinned body that explains a partial cloud best.

In the manner of Ye and Yang, *Real-time simultaneous pose and shape estimation for articulated
objects using a single depth camera* (CVPR 2014). The visible vertices :math:`v_m(\theta)` of the
posed body are the centres of a Gaussian mixture with one variance and an outlier class; the
points :math:`x_n` are samples of it. Each iteration does

*E-step*  :math:`p_{mn} = e^{-\|x_n - v_m\|^2 / 2\sigma^2} / (u + \sum_k e^{-\|x_n - v_k\|^2 / 2\sigma^2})`

*M-step*  one damped Gauss-Newton step on

.. math:: \sum_m P_m \left[ a\,(n_m \cdot (v_m - y_m))^2 + b\,\|v_m - y_m\|^2 \right]
   + E_{free} + E_{prior}, \qquad P_m = \sum_n p_{mn},\; y_m = \sum_n p_{mn} x_n / P_m

with the variance going down from coarse to fine. :math:`E_{free}` keeps vertices out of space
that was seen to be free: beside the silhouette, and in front of the observed surface.
:math:`E_{prior}` holds each joint near the start. The parameters are a translation and, for every
free node, a rotation vector in the camera frame that turns the whole subtree, so that a vertex
moves by :math:`\delta t + \sum_k s_{mk}\, \omega_k \times (v_m - p_k)` with the share
:math:`s_{mk}` of its skin weight below node k: the analytic Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose import _raster_kernels
from depth_pose.body._skin_kernels import skin
from depth_pose.body.body import Body
from depth_pose.registration import _articulated_kernels as kernels
from depth_pose.render import Observation
from depth_pose.skeleton import NODE_INDEX, NODE_PARENTS, NODES

_STIFFNESS: dict[str, float] = {
    "pelvis": 0.0,
    "spine": 1.0,
    "chest": 1.0,
    "neck": 1.0,
    "clavicle": 3.0,
    "shoulder": 0.1,
    "elbow": 0.1,
    "wrist": 2.0,
    "hip": 0.1,
    "knee": 0.1,
    "ankle": 2.0,
}
"""Relative stiffness of each free node toward the start; nodes not named follow their parent."""


@dataclass(frozen=True)
class FitConfig:
    """Settings of the fit; lengths in metres."""

    sigmas: tuple[float, ...] = (0.06, 0.05, 0.04, 0.034, 0.028, 0.024, 0.02, 0.02)
    outlier: float = 0.3
    plane_weight: float = 1.0
    point_weight: float = 0.3
    free_space_weight: float = 0.15
    free_space_slack: float = 0.04
    free_space_limit: float = 0.10
    prior: float = 0.3
    damping: float = 0.02
    max_step: float = 0.35
    max_points: int = 800


@dataclass(frozen=True)
class BodyPose:
    """A pose of the body in the camera frame.

    Attributes
    ----------
    rotations : (21, 3, 3) float64
        Segment rotations, rest pose to camera frame.
    root : (3,) float64
        Pelvis, metres.
    scale : float
    """

    rotations: NDArray[np.float64]
    root: NDArray[np.float64]
    scale: float


class ArticulatedFitter:
    """Fits one body; everything that does not change between frames is prepared here."""

    def __init__(self, body: Body, config: FitConfig | None = None) -> None:
        self.body = body
        self.config = config or FitConfig()
        sparse = body.sparse_weights
        self._influence, self._weight = sparse.nodes, sparse.weights
        self._normals_rest = vertex_normals(body)
        self._free, self._stiffness = _free_nodes()
        self._chain, self._share, self._length = _chains(body.weights, self._free)
        self._vertices = np.empty_like(body.vertices)
        self._normals = np.empty_like(body.vertices)
        self._nodes = np.empty_like(body.nodes)
        self._visible = np.empty(len(body.vertices), np.bool_)
        self._mass = np.empty(len(body.vertices))
        self._target = np.empty_like(body.vertices)

    def fit(
        self,
        points: NDArray[np.float64],
        full: Observation,
        coarse: Observation,
        nearest: NDArray[np.int32],
        start: BodyPose,
        iterations: int | None = None,
    ) -> BodyPose:
        """Fit the body's pose to a cloud.

        Parameters
        ----------
        points : (N, 3) float64
            The person's points in the camera frame, metres.
        full, coarse : Observation
            The same frame on the full grid, for free space, and on a coarse one, for visibility.
        nearest : (h, w, 2) int32
            Nearest person pixel of every pixel of ``full`` (`nearest_person_pixels`).
        start : BodyPose
        iterations : int, optional
            Fewer than the configured number: the last, fine ones are left out.

        Returns
        -------
        BodyPose
        """
        c, camera, far = self.config, full.camera, coarse.camera
        rotations, root = start.rotations.copy(), start.root.copy()
        size = 3 + 3 * int((self._free >= 0).sum())
        moved = np.zeros(size)
        stiffness = np.concatenate([np.zeros(3), np.repeat(self._stiffness, 3)])
        zbuffer = np.empty(coarse.depth.shape)
        count = len(points)
        for sigma in c.sigmas[:iterations]:
            self._place(rotations, root, start.scale)
            _raster_kernels.rasterize(
                self._vertices, self.body.faces, far.fx, far.fy, far.cx, far.cy, zbuffer
            )
            kernels.mark_visible(
                self._vertices, self._normals, zbuffer, far.fx, far.fy, far.cx, far.cy, 0.05, self._visible
            )
            kernels.assign(
                points, self._vertices, self._visible, sigma, c.outlier, self._mass, self._target
            )
            matrix, gradient = np.zeros((size, size)), np.zeros(size)
            chains = (self._chain, self._share, self._length, self._nodes)
            kernels.add_points(
                self._vertices, self._normals, self._mass, self._target, *chains,
                c.plane_weight, c.point_weight, matrix, gradient,
            )  # fmt: skip
            kernels.add_free_space(
                self._vertices, full.depth, full.labels, nearest, camera.fx, camera.fy, camera.cx, camera.cy,
                *chains, c.free_space_weight * count / 800, c.free_space_slack, c.free_space_limit,
                matrix, gradient,
            )  # fmt: skip
            matrix += np.tril(matrix, -1).T
            prior = c.prior * count / 800 * stiffness
            matrix[np.diag_indices(size)] += prior + c.damping * count / 800
            matrix[np.diag_indices(3)] += 1e-6
            step = np.linalg.solve(matrix, gradient - prior * moved)
            most = np.abs(step[3:]).max()
            if most > c.max_step:
                step *= c.max_step / most
            kernels.update(step, self._free, NODE_PARENTS, rotations)
            root += step[:3]
            moved += step
        return BodyPose(rotations, root, start.scale)

    def _place(self, rotations: NDArray[np.float64], root: NDArray[np.float64], scale: float) -> None:
        body = self.body
        skin(
            body.vertices, body.nodes, NODE_PARENTS, self._influence, self._weight,
            rotations, root, scale, self._vertices, self._nodes,
        )  # fmt: skip
        kernels.turn_normals(self._normals_rest, self._influence, rotations, self._normals)


def nearest_person_pixels(observation: Observation) -> NDArray[np.int32]:
    """Row and column of the nearest person pixel for every pixel, shape (h, w, 2)."""
    nearest = np.empty((*observation.labels.shape, 2), np.int32)
    kernels.nearest_person(observation.labels, nearest)
    return nearest


def vertex_normals(body: Body) -> NDArray[np.float64]:
    """Outward unit normals of the rest vertices, weighted by the faces' areas, shape (V, 3)."""
    corners = body.vertices[body.faces]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(body.vertices)
    for k in range(3):
        np.add.at(normals, body.faces[:, k], face)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _free_nodes() -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Number of each node's parameter triple, -1 for none; and the triples' stiffness."""
    free = np.full(len(NODES), -1)
    stiffness = []
    for name, node in NODE_INDEX.items():
        kind = name.split("_")[-1]
        if kind in _STIFFNESS:
            free[node] = len(stiffness)
            stiffness.append(_STIFFNESS[kind])
    return free, np.array(stiffness)


def _chains(
    weights: NDArray[np.float64], free: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.int32]]:
    """For each vertex, the free nodes that move it and with which share of its skin weight."""
    below = weights.copy()  # weight of each node's whole subtree
    for n in range(len(NODES) - 1, 0, -1):
        below[:, NODE_PARENTS[n]] += below[:, n]
    moves = (below > 0.02) & (free >= 0)
    longest = int(moves.sum(axis=1).max())
    chain = np.zeros((len(weights), longest, 2), np.int32)
    share = np.zeros((len(weights), longest))
    length = moves.sum(axis=1).astype(np.int32)
    for i, row in enumerate(moves):
        nodes = np.flatnonzero(row)
        chain[i, : len(nodes), 0] = free[nodes]
        chain[i, : len(nodes), 1] = nodes
        share[i, : len(nodes)] = below[i, nodes]
    return chain, share, length
