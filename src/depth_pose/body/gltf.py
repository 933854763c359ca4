"""Rigged humans from glTF 2.0 files (``.glb``, ``.gltf``), as Blender and Mixamo users have them.

The reader takes the triangles of the skinned meshes, their bones and weights, in the bind pose. Bones are
found by name, as in recorded motion (`find_joints`). The facing direction is estimated from head, hips and
shoulders, so the file's axes and unit do not matter.
"""

from __future__ import annotations

import base64
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from pygltflib import GLTF2, TRIANGLES, Node, Primitive, Skin

from depth_pose.body.body import Body
from depth_pose.body.joint_names import find_joints
from depth_pose.body.rig_nodes import bone_owners, model_turn, place_nodes
from depth_pose.body.rigged import RiggedMesh, rigged_body
from depth_pose.body.source_motion import SourceMotion
from depth_pose.core.errors import InputError
from depth_pose.core.reading import open_ordinary
from depth_pose.core.skeleton import NODES

Array = NDArray[np.float64]

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""Component types and what they are in NumPy, by the glTF 2.0 specification."""
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
"""Numbers in an element of each type, by the glTF 2.0 specification."""
_SAME = 1e-5
"""Vertices closer than this share of the body's size are merged: about 0.01 mm."""


_MOST_BYTES = 1 << 28
"""Size limit of a file and of its buffers together (bytes): 256 MiB; people in games and films have 1 to 50
MiB."""
_MOST_VERTICES = 1_000_000
"""Maximum number of vertices; people have 5,000 to 200,000."""
_MOST_BONES, _MOST_NODES, _MOST_DEPTH = 2000, 100_000, 1000
"""Maximum number of bones; people have 20 to 200."""


@dataclass(frozen=True)
class _Skinned:
    """Vertices (V, 3), faces (F, 3), bones and weights of each vertex (V, 8), in one skin's bind pose."""

    vertices: Array
    faces: NDArray[np.int64]
    bones: NDArray[np.int64]
    weights: Array


def load_gltf_body(path: Path) -> Body:
    """Make a body of a rigged human in a glTF file.

    Raises
    ------
    InputError
        Where the file cannot be read, has no skinned triangles, or a bone is not found by its name.
    """
    try:
        return _load(path)
    except InputError:
        raise
    except Exception as error:  # a document may have any defect
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{path} cannot be read as glTF 2.0 ({reason:.200}); export it as .glb") from error


def _load(path: Path) -> Body:
    document, buffers = _read(path)
    skin = document.skins[_skinned_nodes(path, document)[0].skin]
    mesh, rig = _mesh(path, document, buffers), _rig(path, document, buffers, skin)
    found = find_joints(rig)
    heads = rig.rest_positions()
    turn = model_turn(rig.name, heads, found)
    nodes = place_nodes(heads @ turn.T, found)
    owners = bone_owners(rig, heads @ turn.T, found, nodes)
    weights = np.zeros((len(mesh.vertices), len(NODES)))
    np.add.at(weights, (np.arange(len(weights))[:, None], owners[mesh.bones]), mesh.weights)
    if weights.sum(axis=1).min() <= 0:
        raise InputError(f"{path}: some vertices have no weights; bind all of the mesh to the rig")
    weights /= weights.sum(axis=1, keepdims=True)
    return rigged_body(path.stem, RiggedMesh(mesh.vertices @ turn.T, mesh.faces, weights, nodes))[0]


def _read(path: Path) -> tuple[GLTF2, list[bytes]]:
    """Return the document and its buffers."""
    with open_ordinary(path, _MOST_BYTES) as stream:
        content = stream.read()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # errors in unused parts of the document
        if path.suffix.lower() == ".glb":
            document = GLTF2.load_from_bytes(content)
        else:
            document = GLTF2.gltf_from_json(content.decode("utf-8-sig"))
    for what, items in (("buffers", document.buffers), ("nodes", document.nodes)):
        if len(items) > _MOST_NODES:
            raise InputError(f"{path} has {len(items)} {what}; at most {_MOST_NODES} are read")
    uris = [buffer.uri for buffer in document.buffers]
    inside = document.binary_blob()
    buffers: list[bytes] = []
    for uri in uris:
        buffers.append(inside if uri is None else _read_uri(path, uri))
        if sum(map(len, buffers)) > _MOST_BYTES:
            raise InputError(f"{path}: its buffers are larger than {_MOST_BYTES >> 20} MiB together")
    return document, buffers


def _read_uri(path: Path, uri: str) -> bytes:
    """Read a buffer: of the document itself, or of a file in its folder or below."""
    if uri.startswith("data:"):
        return base64.b64decode(uri.split(",", 1)[1])
    folder = path.parent.resolve()
    beside = (folder / unquote(uri)).resolve()
    if not beside.is_relative_to(folder):
        raise InputError(f"{path}: its buffer {uri!r:.200} is outside of its folder, and is not read")
    try:
        with open_ordinary(beside, _MOST_BYTES) as stream:
            return stream.read()
    except InputError as error:
        raise InputError(f"{path} cannot be read as glTF 2.0: {error}") from error


def _array(document: GLTF2, buffers: list[bytes], number: int) -> NDArray[Any]:
    """Read an accessor, (count, width); normalised integers become 0 to 1."""
    accessor = document.accessors[number]
    if accessor.sparse is not None or accessor.bufferView is None:
        raise ValueError("sparse accessors are not supported")
    view = document.bufferViews[accessor.bufferView]
    dtype, width = np.dtype(_TYPES[accessor.componentType]), _WIDTHS[accessor.type]
    start, step = view.byteOffset + accessor.byteOffset, view.byteStride or width * dtype.itemsize
    if accessor.count > 3 * _MOST_VERTICES:  # three corners per triangle, and a margin
        raise InputError(f"an array of {accessor.count} is too long; at most {3 * _MOST_VERTICES} are read")
    shape, strides = (accessor.count, width), (step, dtype.itemsize)
    array = np.ndarray(shape, dtype, buffers[view.buffer], start, strides)
    return array / np.iinfo(dtype).max if accessor.normalized else array.copy()


def _skinned_nodes(path: Path, document: GLTF2) -> list[Node]:
    """Nodes that hold a mesh with the first skin that is used."""
    nodes = [n for n in document.nodes if n.mesh is not None and n.skin is not None]
    if not nodes:
        raise InputError(f"{path} has no skinned mesh; bind the mesh to an armature before exporting")
    return [n for n in nodes if n.skin == nodes[0].skin]


def _mesh(path: Path, document: GLTF2, buffers: list[bytes]) -> _Skinned:
    """Combine all triangles of one skin; vertices doubled at texture seams are merged."""
    parts: list[_Skinned] = []
    for node in _skinned_nodes(path, document):
        for primitive in document.meshes[node.mesh].primitives:
            if primitive.mode == TRIANGLES and primitive.attributes.JOINTS_0 is not None:
                parts.append(_part(document, buffers, primitive))
                if sum(len(part.vertices) for part in parts) > _MOST_VERTICES:
                    raise InputError(f"{path} has over {_MOST_VERTICES} vertices; make its mesh coarser")
    if not parts:
        raise InputError(f"{path} has no skinned triangles")
    first = np.cumsum([0] + [len(p.vertices) for p in parts])
    faces = np.concatenate([p.faces + k for p, k in zip(parts, first[:-1], strict=True)])
    vertices, bones, weights = (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("vertices", "bones", "weights")
    )
    if not np.isfinite(vertices).all() or not np.isfinite(weights).all():
        raise InputError(f"{path} has vertices or weights that are not finite")
    size = np.ptp(vertices[:, 1]) + np.ptp(vertices[:, 2])
    places = np.round(vertices / (_SAME * size))
    _, kept, number = np.unique(places, axis=0, return_index=True, return_inverse=True)
    return _Skinned(vertices[kept], number.ravel()[faces], bones[kept], weights[kept])


def _part(document: GLTF2, buffers: list[bytes], primitive: Primitive) -> _Skinned:
    """Read one primitive's triangles."""
    at = primitive.attributes
    vertices = _array(document, buffers, at.POSITION).astype(np.float64)
    if primitive.indices is not None:
        faces = _array(document, buffers, primitive.indices).reshape(-1, 3).astype(np.int64)
    else:
        faces = np.arange(len(vertices)).reshape(-1, 3)
    bones, weights = np.zeros((len(vertices), 8), np.int64), np.zeros((len(vertices), 8))
    for k in range(2):  # more than eight bones a vertex are not read
        if hasattr(at, f"JOINTS_{k}"):
            columns = slice(4 * k, 4 * k + 4)
            bones[:, columns] = _array(document, buffers, getattr(at, f"JOINTS_{k}"))
            weights[:, columns] = _array(document, buffers, getattr(at, f"WEIGHTS_{k}"))
    return _Skinned(vertices, faces, bones, weights)


def _rig(path: Path, document: GLTF2, buffers: list[bytes], skin: Skin) -> SourceMotion:
    """Return the bones in the bind pose, parents before children, in the skin's numbering."""
    bones, nodes = skin.joints, document.nodes
    if len(bones) > _MOST_BONES:
        raise InputError(f"{path}: its rig has {len(bones)} bones; at most {_MOST_BONES} are read")
    if skin.inverseBindMatrices is None:
        raise InputError(f"{path}: its rig has no bind pose (inverseBindMatrices)")
    inverse = _array(document, buffers, skin.inverseBindMatrices).astype(np.float64)
    heads: Array = np.linalg.inv(inverse.reshape(-1, 4, 4).transpose(0, 2, 1))[:, :3, 3].astype(np.float64)
    above = {child: k for k, node in enumerate(nodes) for child in node.children}
    number = {bone: k for k, bone in enumerate(bones)}
    parents = np.full(len(bones), -1)
    for k, bone in enumerate(bones):
        parent, steps = above.get(bone), 0
        while parent is not None and parent not in number:
            parent, steps = above.get(parent), steps + 1
            if steps > _MOST_DEPTH:
                raise InputError(f"{path}: its nodes lie in a circle, or over {_MOST_DEPTH} deep")
        parents[k] = -1 if parent is None else number[parent]
    if (parents >= np.arange(len(bones))).any():
        raise InputError(f"{path}: bones come before their parents; export the rig again")
    return SourceMotion(
        name=str(path),
        fps=1.0,
        joints=tuple(nodes[b].name or f"bone{b}" for b in bones),
        parents=parents,
        offsets=np.where(parents[:, None] >= 0, heads - heads[parents], heads),
        rotations=np.tile(np.eye(3), (1, len(bones), 1, 1)),
        root=heads[:1],
    )
