"""Normals of a triangle mesh's vertices."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import lengths_of


class Triangles(Protocol):
    """Any object with ``vertices``, (V, 3) float64, and ``faces``, (F, 3) int32: a `Body` or a mesh."""

    @property
    def vertices(self) -> NDArray[np.float64]: ...  # noqa: D102

    @property
    def faces(self) -> NDArray[np.int32]: ...  # noqa: D102


def vertex_normals(mesh: Triangles) -> NDArray[np.float64]:
    """Outward unit normals of the vertices, (V, 3), weighted by the faces' areas; 0 where no face is."""
    return normals_of(mesh.vertices, mesh.faces, by_face=False)


def normals_of(vertices: NDArray[np.float64], faces: NDArray[np.int32], by_face: bool) -> NDArray[np.float64]:
    """Return `vertex_normals` of a mesh's arrays.

    They are added face by face, or first all faces' first corners: the last bits differ. Simulated
    scenes were made the first way, bodies and banks the second.
    """
    from depth_pose.body._skin_kernels import add_face_normals  # import numba only if needed

    total = np.zeros(vertices.shape)
    add_face_normals(vertices, faces, by_face, total)
    return np.asarray(total / np.maximum(lengths_of(total)[:, None], 1e-12))
