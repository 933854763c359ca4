"""Anny as a body: an optional, realistic one (``pip install 'depth_pose[anny]'``).

R. Brégier et al., *Human mesh modeling for Anny body*, 2025; its mesh and rig come from
MakeHuman. Anny's rest pose is bent into the rest pose of `depth_pose.core.skeleton`, the weights of its
bones are merged into the 21 nodes, parts inside the head are left out, and the mesh is decimated.
All data comes with the package; nothing is downloaded at run time.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.rigged import RiggedMesh, Thinning, rigged_body
from depth_pose.core.extras import require
from depth_pose.core.options import Checked, option
from depth_pose.core.skeleton import NODE_INDEX, NODES

Array = NDArray[np.float64]

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
"""Bones whose heads are the nodes; every other bone moves with its nearest ancestor in this table."""

_TOES = tuple(f"toe{i}-1" for i in range(1, 6))
"""Anny's bones of a foot's toes."""


@dataclass(frozen=True)
class AnnyShape(Checked):
    """Anny's phenotypes; its size does not matter, since the body is scaled to the reference stature."""

    gender: float = option(0.5, "0 male, 1 female", low=0.0, high=1.0)
    age: float = option(0.67, "0 newborn, 0.33 child, 0.67 young adult, 1 old", low=0.0, high=1.0)
    muscle: float = option(0.5, "Muscles", low=0.0, high=1.0)
    weight: float = option(0.5, "Weight", low=0.0, high=1.0)
    height: float = option(0.5, "Tallness, which changes proportions", low=0.0, high=1.0)
    proportions: float = option(0.5, "Uncommon to ideal proportions", low=0.0, high=1.0)


def make_anny_body(shape: AnnyShape | None = None) -> Body:
    """Make a body of Anny.

    Parameters
    ----------
    shape : AnnyShape, optional
        An average adult by default. Bodies of all shapes share their faces.

    Raises
    ------
    ConfigError
        Where Anny is not installed.
    """
    average, thinning = _average()
    return rigged_body("anny", _load(shape), thinning)[0] if shape else average


@lru_cache(maxsize=1)
def _average() -> tuple[Body, Thinning]:
    """Make the average adult; all shapes keep the vertices that its decimation keeps."""
    return rigged_body("anny", _load(AnnyShape()))


@lru_cache(maxsize=1)
def _model() -> Any:
    """Load Anny; the first time compiles its kernels, for a minute."""
    require("anny", "the body 'anny'")
    from anny import Anny

    return Anny()


@lru_cache(maxsize=1)
def _rig() -> tuple[Array, NDArray[np.int64]]:
    """Skin weights, merged into our nodes, and triangles of Anny, which all its shapes share."""
    model = _model()
    owners = bone_owners(list(model.bone_labels), [int(p) for p in model.bone_parents])
    index, weight = np.asarray(model.vertex_bone_indices.cpu()), _array(model.vertex_bone_weights)
    weights = np.zeros((len(index), len(NODES)))
    np.add.at(weights, (np.arange(len(index))[:, None], owners[index]), weight)
    faces = np.asarray(model.faces.cpu(), np.int64)
    if faces.shape[1] == 4:
        faces = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    return weights / weights.sum(axis=1, keepdims=True), faces


def _load(shape: AnnyShape) -> RiggedMesh:
    """Read Anny's rest pose, rig and skin weights."""
    model = _model()
    rest = model(phenotype_kwargs=asdict(shape))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # Anny's z is up, -y forward
    heads = _array(rest["rest_bone_heads"][0]) @ turn.T
    weights, faces = _rig()
    nodes = _place_nodes(list(model.bone_labels), heads)
    return _largest_part(RiggedMesh(_array(rest["rest_vertices"][0]) @ turn.T, faces, weights, nodes))


def _array(tensor: object) -> Array:
    return np.asarray(tensor.detach().cpu().double().numpy())  # type: ignore[attr-defined]


def split_side(bone: str) -> tuple[str, str]:
    """Return a bone's name without its side, and our prefix of the side: ``foot.L``: ``foot, left_``."""
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
