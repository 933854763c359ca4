"""Normals of a triangle mesh's vertices."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Triangles(Protocol):
    """What has ``vertices``, (V, 3) float64, and ``faces``, (F, 3) int32: a `Body`, a mesh."""

    @property
    def vertices(self) -> NDArray[np.float64]: ...  # noqa: D102

    @property
    def faces(self) -> NDArray[np.int32]: ...  # noqa: D102


def vertex_normals(mesh: Triangles) -> NDArray[np.float64]:
    """Outward unit normals of the vertices, (V, 3), weighted by the faces' areas; 0 where no face is."""
    from depth_pose.body._skin_kernels import add_face_normals  # numba only for those who compute

    total = np.zeros_like(mesh.vertices)
    add_face_normals(mesh.vertices, mesh.faces, total)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))
