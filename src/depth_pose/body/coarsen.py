"""Coarse copies of a body, for rendering it small and often."""

from __future__ import annotations

import numpy as np

from depth_pose.body.body import Body
from depth_pose.body.normals import vertex_normals
from depth_pose.core.farthest_points import farthest_rows, nearest_points

_WEIGHT_M = 0.25
"""Distance in space (m) that weighs as much as belonging to another segment;
``test/body/test_coarsen.py`` checks the result.
"""


def coarsen(body: Body, vertices: int) -> Body:
    """Cluster a body's vertices and keep one of each cluster.

    The kept ones lie far apart in space and skin weights (greedy farthest-point selection,
    Gonzalez 1985), so that limbs which touch in the rest pose stay apart. Faces within one cluster or between
    two vanish. A kept vertex is moved out by its cluster's mean depth below it, so that the curved surface
    does not shrink.

    Parameters
    ----------
    body : Body
    vertices : int
        Maximum number of vertices; a body with no more is returned unchanged.

    Returns
    -------
    Body
        It has the same skeleton and motion. Its surface may have folds and small gaps.
    """
    if len(body.vertices) <= vertices:
        return body
    place = np.concatenate([body.vertices, _WEIGHT_M * body.weights], axis=1)
    kept = farthest_rows(place, vertices, start=int(np.argmax(body.vertices[:, 1])))
    cluster = nearest_points(place, place[kept])
    normals = vertex_normals(body)
    below = ((body.vertices[kept][cluster] - body.vertices) * normals[kept][cluster]).sum(axis=1)
    sizes = np.bincount(cluster, minlength=len(kept))  # clusters are empty where vertices are doubled
    depth = np.bincount(cluster, below, len(kept)) / np.maximum(sizes, 1)
    faces = cluster[body.faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[whole]
    first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]
    return Body(
        name=body.name,
        vertices=body.vertices[kept] + depth[:, None] * normals[kept],
        faces=np.ascontiguousarray(faces[np.sort(first)]),
        weights=body.weights[kept],
        nodes=body.nodes,
        stature=body.stature,
    )
