"""A skinned body and its poses.

Linear blend skinning with the project's node rotations (rest pose to posed, not relative to
the parent): ``v' = sum_n w_n (s R_n (v - c_n) + p_n)``, with c_n a node's rest position, p_n its
posed one from `depth_pose.core.skeleton.forward_kinematics`, and s the body's scale.
"""

from __future__ import annotations

import hashlib
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.normals import vertex_normals
from depth_pose.core.skeleton import NODE_PARENTS, Nodes

if TYPE_CHECKING:
    from depth_pose.body._skin_kernels import Skin

INFLUENCES = 4
"""Greatest number of nodes that move one vertex."""


@dataclass(frozen=True)
class PosedBody:
    """A body in a pose.

    Attributes
    ----------
    vertices : (V, 3) float64
        Metres, in the frame that the rotations lead to.
    nodes : (21, 3) float64
        Positions of `depth_pose.core.skeleton.NODES` in the same frame, metres.
    """

    vertices: NDArray[np.float64]
    nodes: Nodes


@dataclass(frozen=True, eq=False)
class Body:
    """A skinned body in the rest pose of `depth_pose.core.skeleton`.

    Attributes
    ----------
    name : str
    vertices : (V, 3) float64
        Model frame (x to the person's left, y up, z forward, floor at y = 0), metres.
    faces : (F, 3) int32
        Watertight, counter-clockwise seen from outside.
    weights : (V, 21) float64
        Skin weights; rows sum to 1 and have at most `INFLUENCES` entries.
    nodes : (21, 3) float64
        Rest positions of the nodes, model frame, metres.
    stature : float
        Height standing upright, metres.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    weights: NDArray[np.float64]
    nodes: NDArray[np.float64]
    stature: float

    def __post_init__(self) -> None:
        v, n = len(self.vertices), len(NODE_PARENTS)
        shapes = {"vertices": (v, 3), "weights": (v, n), "nodes": (n, 3)}
        for field, shape in shapes.items():
            if getattr(self, field).shape != shape:
                raise ValueError(f"Body.{field} has shape {getattr(self, field).shape}; it must be {shape}")
        if not np.allclose(self.weights.sum(axis=1), 1.0, atol=1e-6):
            raise ValueError("Body.weights: every row must sum to 1")
        if int((self.weights > 0).sum(axis=1).max()) > INFLUENCES:
            raise ValueError(f"Body.weights: at most {INFLUENCES} nodes may move a vertex")

    @cached_property
    def skin(self) -> Skin:
        """The body in the form of the kernels' argument, without zero weights."""
        from depth_pose.body._skin_kernels import Skin

        order = np.argsort(-self.weights, axis=1, kind="stable")[:, :INFLUENCES]
        return Skin(
            vertices=self.vertices,
            nodes=self.nodes,
            parents=NODE_PARENTS,
            influence=np.ascontiguousarray(order.astype(np.int32)),
            weight=np.ascontiguousarray(np.take_along_axis(self.weights, order, axis=1)),
            faces=self.faces,
        )

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """Outward unit normals of the rest vertices, (V, 3)."""
        return vertex_normals(self)

    def pose(
        self, rotations: NDArray[np.float64], root: NDArray[np.float64], scale: float = 1.0
    ) -> PosedBody:
        """Pose the body by linear blend skinning.

        Parameters
        ----------
        rotations : (21, 3, 3)
            Rotation of each node's segment, rest pose to the target frame.
        root : (3,)
            Position of the pelvis in the target frame, metres.
        scale : float
            Factor on the whole body's size.
        """
        from depth_pose.body._skin_kernels import skin

        vertices = np.empty_like(self.vertices)
        nodes = np.empty_like(self.nodes)
        skin(
            self.skin,
            np.ascontiguousarray(rotations, dtype=np.float64),
            np.ascontiguousarray(root, dtype=np.float64),
            float(scale),
            vertices,
            nodes,
        )
        return PosedBody(vertices, Nodes(nodes))

    def place(self, rotations: NDArray[np.float64], root: NDArray[np.float64], scale: float = 1.0) -> Nodes:
        """Return only the nodes (21, 3) of a pose; arguments as of `pose`."""
        from depth_pose.body._skin_kernels import place_nodes

        nodes = np.empty_like(self.nodes)
        place_nodes(self.nodes, NODE_PARENTS, rotations, root, scale, nodes)
        return Nodes(nodes)

    def reshaped(self, vertices: NDArray[np.float64], nodes: NDArray[np.float64]) -> Body:
        """Return the body with another rest pose, (V, 3) and (21, 3); everything else is shared."""
        body = copy(self)  # not made by `__init__`, which checks the weights
        body.__dict__.pop("normals", None)
        body.__dict__.update(
            vertices=vertices, nodes=nodes, skin=self.skin._replace(vertices=vertices, nodes=nodes)
        )
        return body

    def content_hash(self) -> str:
        """SHA-256 of the body's geometry, weights and nodes; identical on every machine."""
        digest = hashlib.sha256()
        for array in (self.vertices, self.faces, self.weights, self.nodes):
            digest.update(str(array.shape).encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


def keep_largest(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Keep each vertex's `INFLUENCES` largest weights, (V, 21), and make them sum to 1."""
    order = np.argsort(-weights, axis=1, kind="stable")
    kept = weights.copy()
    np.put_along_axis(kept, order[:, INFLUENCES:], 0.0, axis=1)
    total = kept.sum(axis=1, keepdims=True)
    # rows that sum to 1 are unchanged, bit by bit
    return np.ascontiguousarray(kept / np.where(np.abs(total - 1.0) < 1e-12, 1.0, total))
