"""Bodies from rigged meshes: moved to the rest pose, decimated, and scaled to the reference adult."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body._skin_kernels import Skin, skin
from depth_pose.body.body import Body, keep_largest
from depth_pose.core.open3d import load_open3d
from depth_pose.core.rotations import rotation_between
from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX, NODE_PARENTS, NODES, rest_nodes

Array = NDArray[np.float64]

MOST_VERTICES = 2500
"""Target number of vertices after decimation; the embedded body has 2,069."""

_LIMB_CHILD = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle", "ankle": "foot"}


@dataclass(frozen=True)
class RiggedMesh:
    """A mesh with its rig in the model frame.

    Attributes
    ----------
    vertices : (V, 3) float64
        Metres, x to the person's left, y up, z forward.
    faces : (F, 3) int64
    weights : (V, 21) float64
        Merged into our nodes; rows sum to 1.
    nodes : (21, 3) float64
    """

    vertices: Array
    faces: NDArray[np.int64]
    weights: Array
    nodes: Array


@dataclass(frozen=True)
class Thinning:
    """Part of a mesh's vertices, (V,), and triangles between them, (F, 3), numbered anew."""

    vertices: NDArray[np.int64]
    faces: NDArray[np.int64]


def rigged_body(name: str, mesh: RiggedMesh, thinning: Thinning | None = None) -> tuple[Body, Thinning]:
    """Make a body of a rigged mesh: in the rest pose of `depth_pose.core.skeleton`, thinned and scaled.

    Parameters
    ----------
    name : str
    mesh : RiggedMesh
        In any pose and of any size.
    thinning : Thinning, optional
        Thinning of another shape of the same mesh, so that the same vertices are kept.
    """
    mesh = _to_rest_pose(mesh)
    if thinning is None:
        thinned, thinning = _decimate(mesh)
    else:
        kept = thinning.vertices
        thinned = RiggedMesh(mesh.vertices[kept], thinning.faces, mesh.weights[kept], mesh.nodes)
    low, high = thinned.vertices[:, 1].min(), thinned.vertices[:, 1].max()
    scale = ADULT_STATURE_M / (high - low)
    middle = np.array([thinned.nodes[0, 0], low, thinned.nodes[0, 2]])
    body = Body(
        name=name,
        vertices=np.ascontiguousarray((thinned.vertices - middle) * scale),
        faces=np.ascontiguousarray(thinned.faces, np.int32),
        weights=keep_largest(thinned.weights),
        nodes=np.ascontiguousarray((thinned.nodes - middle) * scale),
        stature=ADULT_STATURE_M,
    )
    return body, thinning


def _to_rest_pose(mesh: RiggedMesh) -> RiggedMesh:
    """Turn the limbs so that every bone points as in our rest pose."""
    wanted = rest_nodes()
    rotations = np.tile(np.eye(3), (len(NODES), 1, 1))
    for n in range(1, len(NODES)):
        rotations[n] = rotations[NODE_PARENTS[n]]
        side, _, bare = NODES[n].rpartition("_")
        if bare in _LIMB_CHILD:
            child = NODE_INDEX[f"{side}_{_LIMB_CHILD[bare]}"]
            have = rotations[n] @ (mesh.nodes[child] - mesh.nodes[n])
            bone = wanted[child] - wanted[n]
            have, bone = have / np.linalg.norm(have), bone / np.linalg.norm(bone)
            rotations[n] = rotation_between(have, bone) @ rotations[n]
    vertices, nodes = np.empty_like(mesh.vertices), np.empty_like(mesh.nodes)
    order = np.ascontiguousarray(np.argsort(-mesh.weights, axis=1, kind="stable").astype(np.int32))
    weights = np.ascontiguousarray(np.take_along_axis(mesh.weights, order, axis=1))
    rest = (np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.nodes))
    body = Skin(*rest, NODE_PARENTS, order, weights, np.ascontiguousarray(mesh.faces, np.int32))
    skin(body, rotations, mesh.nodes[0].copy(), 1.0, vertices, nodes)
    return RiggedMesh(vertices, mesh.faces, mesh.weights, nodes)


def _decimate(mesh: RiggedMesh) -> tuple[RiggedMesh, Thinning]:
    """Collapse edges by the quadric error; weights are those of the nearest former vertex."""
    open3d = load_open3d()
    from scipy.spatial import cKDTree

    fine = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices),
        open3d.utility.Vector3iVector(mesh.faces.astype(np.int32)),
    )
    coarse = fine.simplify_quadric_decimation(2 * MOST_VERTICES)
    coarse.remove_unreferenced_vertices()
    vertices = np.asarray(coarse.vertices).copy()
    nearest = cKDTree(mesh.vertices).query(vertices)[1]
    faces = np.asarray(coarse.triangles).astype(np.int64)
    return RiggedMesh(vertices, faces, mesh.weights[nearest], mesh.nodes), Thinning(nearest, faces)
