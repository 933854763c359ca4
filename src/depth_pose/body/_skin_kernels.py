"""Compiled skinning; `depth_pose.body.body` is its public side."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.kernels import njit


class Skin(NamedTuple):
    """A body in the form of the kernels' argument.

    Attributes
    ----------
    vertices, nodes : (V, 3), (21, 3) float64
        Rest pose, metres.
    parents : (21,) int64
        Of the nodes, -1 for the root.
    influence, weight : (V, K) int32, (V, K) float64
        Nodes that move each vertex, and their shares, largest first.
    faces : (F, 3) int32
    """

    vertices: NDArray[np.float64]
    nodes: NDArray[np.float64]
    parents: NDArray[np.int64]
    influence: NDArray[np.int32]
    weight: NDArray[np.float64]
    faces: NDArray[np.int32]


@njit(cache=True)
def place_nodes(rest: Any, parents: Any, rotations: Any, root: Any, scale: float, out_nodes: Any) -> None:
    """Walk the tree from rest positions (21, 3) to posed ones."""
    for k in range(3):
        out_nodes[0, k] = root[k]
    for n in range(1, rest.shape[0]):
        p = parents[n]
        d0, d1, d2 = rest[n, 0] - rest[p, 0], rest[n, 1] - rest[p, 1], rest[n, 2] - rest[p, 2]
        for k in range(3):
            out_nodes[n, k] = out_nodes[p, k] + scale * (
                rotations[p, k, 0] * d0 + rotations[p, k, 1] * d1 + rotations[p, k, 2] * d2
            )


@njit(cache=True)
def skin(body: Any, rotations: Any, root: Any, scale: float, out_vertices: Any, out_nodes: Any) -> None:
    """Walk the tree, then blend; writes (V, 3) vertices and (21, 3) nodes of a `Skin`."""
    rest, nodes_rest, parents, index, weights = (
        body.vertices,
        body.nodes,
        body.parents,
        body.influence,
        body.weight,
    )
    n_nodes = nodes_rest.shape[0]
    moves = np.empty((n_nodes, 12))
    place_nodes(nodes_rest, parents, rotations, root, scale, out_nodes)
    for n in range(n_nodes):
        for k in range(3):
            shift = out_nodes[n, k]
            for j in range(3):
                moves[n, 4 * k + j] = scale * rotations[n, k, j]
                shift -= moves[n, 4 * k + j] * nodes_rest[n, j]
            moves[n, 4 * k + 3] = shift
    for i in range(rest.shape[0]):
        x, y, z = rest[i, 0], rest[i, 1], rest[i, 2]
        a = b = c = 0.0
        for j in range(index.shape[1]):
            w = weights[i, j]
            if w == 0.0:
                break
            m = moves[index[i, j]]
            a += w * (m[0] * x + m[1] * y + m[2] * z + m[3])
            b += w * (m[4] * x + m[5] * y + m[6] * z + m[7])
            c += w * (m[8] * x + m[9] * y + m[10] * z + m[11])
        out_vertices[i, 0] = a
        out_vertices[i, 1] = b
        out_vertices[i, 2] = c


@njit(cache=True)
def add_face_normals(vertices: Any, faces: Any, by_face: bool, out: Any) -> None:
    """Add every face's normal, of twice its area in length, to its three vertices, (V, 3).

    The order is face by face, or first all faces' first corners.
    """
    outer, inner = (faces.shape[0], 3) if by_face else (3, faces.shape[0])
    for i in range(outer):
        for j in range(inner):
            f, corner = (i, j) if by_face else (j, i)
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            p, q, r = vertices[a], vertices[b], vertices[c]
            ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
            at = faces[f, corner]
            out[at, 0] += uy * vz - uz * vy
            out[at, 1] += uz * vx - ux * vz
            out[at, 2] += ux * vy - uy * vx
