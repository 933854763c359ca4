"""A basis of smooth displacement fields of a body, from distances along its surface.

With Euclidean distances, coherent point drift moves a hand along with the thigh that it touches. Along the
surface the two are far apart in every pose, and the distances change so little with the pose that those of
the rest mesh serve all exemplars: one basis per body, computed once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from depth_pose.core.farthest_points import farthest_rows
from depth_pose.paper.cpd import nystroem_basis

Array = NDArray[np.float64]


def geodesic_basis(vertices: Array, faces: NDArray[np.integer], count: int, beta: float) -> Array:
    """Compute a basis of displacement fields that are smooth along a mesh's surface.

    Parameters
    ----------
    vertices : (V, 3) float64
        Rest mesh, metres.
    faces : (F, 3) int
    count : int
        Vertices from which the kernel is approximated.
    beta : float
        Width of the Gaussian kernel, metres.

    Returns
    -------
    (V, K) float64
        Rows of visible vertices are a basis for `depth_pose.paper.cpd.register`.
    """
    chosen = farthest_rows(vertices, count)
    return nystroem_basis(surface_distances(vertices, faces, chosen), chosen, beta)


def surface_distances(vertices: Array, faces: NDArray[np.integer], chosen: NDArray[np.integer]) -> Array:
    """Compute the distance along the surface from the chosen vertices to all, shape (V, C), metres.

    Shortest paths over the mesh's edges and over the pairs of vertices opposite an edge, which reduces the
    detours of edge paths to a few percent. The distance to disconnected parts is infinite.
    """
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    opposite = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    n = len(vertices)
    key = directed.min(axis=1).astype(np.int64) * n + directed.max(axis=1)
    order = np.argsort(key, kind="stable")
    twins = key[order][1:] == key[order][:-1]
    across = np.stack([opposite[order][1:][twins], opposite[order][:-1][twins]], axis=1)
    pairs = np.concatenate([directed, across])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    lengths = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)
    graph = sparse.csr_matrix((lengths, (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(dijkstra(graph, directed=False, indices=chosen).T)
