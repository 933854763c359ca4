"""The paper's refinement of one exemplar (Sec. 6): register, complete, transfer the joints.

The exemplar's visible vertices are registered to the input by coherent point drift (`depth_pose.paper.cpd`);
their correspondences deform the complete mesh (`depth_pose.paper.laplacian`, Ye et al. eq. 7); the joints
follow their control vertices (`depth_pose.paper.rigid`, Ye et al. eq. 8). What is hidden comes from the
exemplar.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body, PosedBody
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.body.rendered_depth import Observation, render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import NODES, Nodes
from depth_pose.paper.coherence import geodesic_basis
from depth_pose.paper.cpd import register
from depth_pose.paper.laplacian import LaplacianCompleter
from depth_pose.paper.rigid import JointTransfer
from depth_pose.paper.tuning import CompletionTuning, CpdTuning
from depth_pose.refine import _visibility_kernels as visibility
from depth_pose.refine.skeleton_pose import pose_from_nodes

Array = NDArray[np.float64]


class MeshCompleter:
    """Completes meshes of one body; all data that is constant between frames is prepared here."""

    def __init__(
        self, body: Body, tuning: CompletionTuning = CompletionTuning(), cpd: CpdTuning = CpdTuning()
    ) -> None:
        self.body = body
        self.tuning, self.cpd = tuning, cpd
        self._basis = geodesic_basis(body.vertices, body.faces, self.cpd.basis_points, self.cpd.beta)
        self._laplacian = LaplacianCompleter(body.vertices, body.faces)
        self._transfer = JointTransfer(body)

    def of(self, body: Body) -> MeshCompleter:
        """Return the same completer for another build of its body.

        Coherence and Laplacian act on displacements, so they are shared; they change little with a build.
        """
        if body is self.body:
            return self
        other = copy(self)
        other.body = body
        return other

    def fit(self, points: Array, coarse: Observation, start: BodyPose) -> FittedBody:
        """Deform the body, posed at a candidate, to a cloud, in all passes.

        Parameters
        ----------
        points : (N, 3) float64
            The person's points in the camera frame, metres.
        coarse : Observation
            The frame at low resolution, used to determine the visible vertices.
        start : BodyPose

        Returns
        -------
        FittedBody
        """
        return self.finish(points, coarse, self.begin(points, coarse, start))

    def finish(self, points: Array, coarse: Observation, found: FittedBody) -> FittedBody:
        """Return the result of all passes after the first; arguments as of `fit`."""
        for _ in range(1, self.tuning.passes):
            pose = pose_from_nodes(self.body, found.pose.rotations, found.nodes, found.pose.scale)
            found = self.begin(points, coarse, pose)
        return found

    def begin(self, points: Array, coarse: Observation, start: BodyPose) -> FittedBody:
        """Register, complete and transfer the joints, in one pass; arguments as of `fit`."""
        t = self.tuning
        posed = self.body.pose(start.rotations, start.root, start.scale)
        facing = self.visible(posed, start.rotations, coarse)
        visible = np.flatnonzero(facing > 0.0)
        if len(visible) == 0:
            return FittedBody(start, posed.vertices, posed.nodes)
        if len(visible) > t.max_vertices:
            visible = visible[np.arange(t.max_vertices) * len(visible) // t.max_vertices]
        found = register(posed.vertices[visible], points, self.cpd, self._basis[visible])
        targets, weights = posed.vertices.copy(), np.zeros(len(posed.vertices))
        targets[visible] = found.moved
        sure = (found.probability > t.min_probability) & (facing[visible] > t.min_facing)
        weights[visible] = t.weight * sure
        return self.complete(start, posed, targets, weights)

    def complete(self, pose: BodyPose, posed: PosedBody, targets: Array, weights: Array) -> FittedBody:
        """Deform a posed body to correspondences and transfer its joints (Ye et al. eqs. 7, 8).

        Parameters
        ----------
        pose : BodyPose
            The pose of ``posed``.
        posed : PosedBody
        targets : (V, 3) float64
        weights : (V,) float64

        Returns
        -------
        FittedBody
        """
        vertices = self._laplacian.complete(posed.vertices, targets, weights)
        nodes, rotations = self._transfer.transfer(posed.vertices, posed.nodes, pose.rotations, vertices)
        return FittedBody(BodyPose(rotations, nodes[0], pose.scale), vertices, Nodes(nodes))

    def warm_up(self) -> None:
        """Compile every kernel, by fitting the rest pose to itself."""
        still = BodyPose(np.tile(R_CAMERA_FACING_MODEL, (len(NODES), 1, 1)), np.array([0.0, 0.0, 3.0]), 1.0)
        view = Observation(
            np.zeros((48, 48), np.float32),
            np.zeros((48, 48), np.uint8),
            Camera(48, 48, 60.0, 60.0, 24.0, 24.0),
        )
        points = self.body.pose(still.rotations, still.root).vertices[::4]
        self.fit(points, view, still)

    def visible(self, posed: PosedBody, rotations: Array, coarse: Observation) -> Array:
        """Compute the visibility of each vertex of a posed body.

        Returns
        -------
        (V,) float64
            Cosine between the vertex's normal and the ray to it; 0 if invisible.
        """
        normals = np.empty_like(posed.vertices)
        seen = np.empty(len(posed.vertices), np.bool_)
        zbuffer = render_depth(posed.vertices, self.body.faces, coarse.camera)
        visibility.turn_normals(self.body.normals, self.body.skin.influence, rotations, normals)
        tolerance = self.tuning.visible_tolerance
        visibility.mark_visible(posed.vertices, normals, zbuffer, coarse.camera, tolerance, seen)
        cosine = -np.einsum("ij,ij->i", normals, posed.vertices) / np.linalg.norm(posed.vertices, axis=1)
        return np.where(seen, cosine, 0.0)
