"""Normals of a triangle mesh's vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def vertex_normals(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], by_face: bool = False
) -> NDArray[np.float64]:
    """Outward unit normals of a mesh's vertices, weighted by the faces' areas; 0 where no face is.

    Parameters
    ----------
    vertices : (V, 3) float64
    faces : (F, 3) int32
    by_face : bool
        Add the faces one after the other, not first what they add to their first corners: the
        last bits differ. Simulated scenes were made so, bodies the other way.

    Returns
    -------
    (V, 3) float64
    """
    from depth_pose.body._skin_kernels import add_face_normals  # numba only for those who compute

    total = np.zeros_like(vertices)
    add_face_normals(vertices, faces, by_face, total)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))
