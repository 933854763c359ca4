"""Rigged humans from glTF 2.0 files (``.glb``, ``.gltf``), as Blender and Mixamo users have them.

Read is what a body needs: the triangles of the skinned meshes, their bones and weights, in the
bind pose. Bones are found by name as those of recorded motion are (`find_joints`). Which way the
person faces is told from head, hips and shoulders, so the file's axes and unit do not matter.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.body._joint_names import find_joints
from depth_pose.body.body import Body
from depth_pose.body.rigged import RiggedMesh, rigged_body
from depth_pose.body.source_motion import SourceMotion
from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import NODE_INDEX, NODES, rest_nodes

Array = NDArray[np.float64]

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_TRUNK = ("pelvis", "spine", "chest", "neck")
_LIMBS = ("clavicle", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")


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
        document, buffers = _read(path)
        skin = document["skins"][_skinned_nodes(path, document)[0]["skin"]]
        mesh, rig = _mesh(path, document, buffers), _rig(path, document, buffers, skin)
    except (OSError, ValueError, KeyError, IndexError, TypeError, struct.error, binascii.Error) as error:
        raise InputError(f"{path} cannot be read as glTF 2.0 ({error!r}); export it as .glb") from error
    found = find_joints(rig)
    heads = rig.rest_positions()
    turn = _turn(path, heads, found)
    nodes = _place_nodes(heads @ turn.T, found)
    owners = _bone_owners(rig, heads @ turn.T, found, nodes)
    weights = np.zeros((len(mesh.vertices), len(NODES)))
    np.add.at(weights, (np.arange(len(weights))[:, None], owners[mesh.bones]), mesh.weights)
    if weights.sum(axis=1).min() <= 0:
        raise InputError(f"{path}: some vertices have no weights; bind all of the mesh to the rig")
    weights /= weights.sum(axis=1, keepdims=True)
    return rigged_body(path.stem, RiggedMesh(mesh.vertices @ turn.T, mesh.faces, weights, nodes))


def _read(path: Path) -> tuple[dict[str, Any], list[bytes]]:
    """Give the JSON document and its buffers."""
    data = path.read_bytes()
    binary = b""
    if data[:4] == b"glTF":
        length, kind = struct.unpack_from("<I4s", data, 12)
        if kind != b"JSON":
            raise ValueError("the first chunk is not JSON")
        document = json.loads(data[20 : 20 + length])
        binary = data[20 + length + 8 :]
    else:
        document = json.loads(data)
    buffers = []
    for buffer in document["buffers"]:
        uri = buffer.get("uri")
        if uri is None:
            buffers.append(binary)
        elif uri.startswith("data:"):
            buffers.append(base64.b64decode(uri.split(",", 1)[1]))
        else:
            buffers.append((path.parent / uri).read_bytes())
    return document, buffers


def _array(document: dict[str, Any], buffers: list[bytes], number: int) -> NDArray[Any]:
    """Read an accessor, (count, width); integers that stand for 0 to 1 become that."""
    accessor = document["accessors"][number]
    if "sparse" in accessor or "bufferView" not in accessor:
        raise ValueError("sparse accessors are not supported")
    view = document["bufferViews"][accessor["bufferView"]]
    dtype, width = np.dtype(_TYPES[accessor["componentType"]]), _WIDTHS[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    shape, step = (accessor["count"], width), view.get("byteStride", width * dtype.itemsize)
    array = np.ndarray(shape, dtype, buffers[view["buffer"]], start, (step, dtype.itemsize))
    if accessor.get("normalized"):
        return array / np.iinfo(dtype).max
    return array.copy()


def _skinned_nodes(path: Path, document: dict[str, Any]) -> list[dict[str, Any]]:
    """Nodes that hold a mesh with the first skin that is used."""
    nodes = [n for n in document["nodes"] if "mesh" in n and "skin" in n]
    if not nodes:
        raise InputError(f"{path} has no skinned mesh; bind the mesh to an armature before exporting")
    return [n for n in nodes if n["skin"] == nodes[0]["skin"]]


def _mesh(path: Path, document: dict[str, Any], buffers: list[bytes]) -> _Skinned:
    """Put all triangles of one skin together."""
    parts, first = [], 0
    for node in _skinned_nodes(path, document):
        for primitive in document["meshes"][node["mesh"]]["primitives"]:
            at = primitive["attributes"]
            if primitive.get("mode", 4) != 4 or "JOINTS_0" not in at:
                continue
            vertices = _array(document, buffers, at["POSITION"]).astype(np.float64)
            if "indices" in primitive:
                faces = _array(document, buffers, primitive["indices"]).reshape(-1, 3).astype(np.int64)
            else:
                faces = np.arange(len(vertices)).reshape(-1, 3)
            bones, weights = np.zeros((len(vertices), 8), np.int64), np.zeros((len(vertices), 8))
            for k in range(2):  # more than eight bones a vertex are not read
                if f"JOINTS_{k}" in at:
                    columns = slice(4 * k, 4 * k + 4)
                    bones[:, columns] = _array(document, buffers, at[f"JOINTS_{k}"])
                    weights[:, columns] = _array(document, buffers, at[f"WEIGHTS_{k}"])
            parts.append(_Skinned(vertices, faces + first, bones, weights))
            first += len(vertices)
    if not parts:
        raise InputError(f"{path} has no skinned triangles")
    whole = [
        np.concatenate([getattr(p, n) for p in parts]) for n in ("vertices", "faces", "bones", "weights")
    ]
    # vertices are doubled where textures have seams
    size = np.ptp(whole[0][:, 1]) + np.ptp(whole[0][:, 2])
    _, kept, number = np.unique(
        np.round(whole[0] / (1e-5 * size)), axis=0, return_index=True, return_inverse=True
    )
    return _Skinned(whole[0][kept], number.ravel()[whole[1]], whole[2][kept], whole[3][kept])


def _rig(path: Path, document: dict[str, Any], buffers: list[bytes], skin: dict[str, Any]) -> SourceMotion:
    """Give the bones in the bind pose, parents before children, and in the skin's numbering."""
    bones, nodes = skin["joints"], document["nodes"]
    if "inverseBindMatrices" not in skin:
        raise InputError(f"{path}: its rig has no bind pose (inverseBindMatrices)")
    inverse = _array(document, buffers, skin["inverseBindMatrices"]).astype(np.float64)
    heads: Array = np.linalg.inv(inverse.reshape(-1, 4, 4).transpose(0, 2, 1))[:, :3, 3].astype(np.float64)
    above = {child: k for k, node in enumerate(nodes) for child in node.get("children", ())}
    parents = np.full(len(bones), -1)
    for k, bone in enumerate(bones):
        parent = above.get(bone)
        while parent is not None and parent not in bones:
            parent = above.get(parent)
        parents[k] = -1 if parent is None else bones.index(parent)
    if (parents >= np.arange(len(bones))).any():
        raise InputError(f"{path}: bones come before their parents; export the rig again")
    offsets = np.where(parents[:, None] >= 0, heads - heads[parents], heads)
    names = tuple(str(nodes[b].get("name", f"bone{b}")) for b in bones)
    return SourceMotion(
        name=str(path),
        fps=1.0,
        joints=names,
        parents=parents,
        offsets=offsets,
        rotations=np.tile(np.eye(3), (1, len(bones), 1, 1)),
        root=heads[:1],
    )


def _turn(path: Path, heads: Array, found: dict[str, int]) -> Array:
    """Rotation from the file's axes to ours, which brings hips, shoulders and head to where ours are."""
    names = ("left_hip", "right_hip", "left_shoulder", "right_shoulder", "head")
    theirs = _trunk_axes(heads[[found[n] for n in names]])
    if not np.isfinite(theirs).all():
        raise InputError(f"{path}: head, hips and shoulders of the rig lie in one place")
    return np.asarray(_trunk_axes(rest_nodes()[[NODE_INDEX[n] for n in names]]).T @ theirs)


def _trunk_axes(points: Array) -> Array:
    """Axes to the left, up and forward, as rows, of two hips, two shoulders and a head."""
    with np.errstate(invalid="ignore", divide="ignore"):
        up = points[4] - points[:2].mean(axis=0)
        up = up / np.linalg.norm(up)
        left = points[2] - points[3]
        left = left - up * (left @ up)
        left = left / np.linalg.norm(left)
    return np.stack([left, up, np.cross(left, up)])


def _place_nodes(heads: Array, found: dict[str, int]) -> Array:
    """Our nodes: limbs and head at the rig's joints, the trunk between hips, shoulders and head."""
    ours = rest_nodes()

    def middle(at: Any, part: str) -> Array:
        return np.asarray((at(f"left_{part}") + at(f"right_{part}")) / 2)

    def rest(name: str) -> Array:
        return np.asarray(ours[NODE_INDEX[name]])

    def rig(name: str) -> Array:
        return np.asarray(heads[found[name]])

    hips, shoulders, rest_hips = middle(rig, "hip"), middle(rig, "shoulder"), middle(rest, "hip")
    size = np.linalg.norm(shoulders - hips) / np.linalg.norm(middle(rest, "shoulder") - rest_hips)
    nodes = hips + size * (ours - rest_hips)
    rise = (rest("neck")[1] - middle(rest, "shoulder")[1]) / (rest("head")[1] - middle(rest, "shoulder")[1])
    nodes[NODE_INDEX["head"]] = rig("head")
    nodes[NODE_INDEX["neck"]] = shoulders + rise * (rig("head") - shoulders)
    for side in ("left_", "right_"):
        for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
            nodes[NODE_INDEX[side + part]] = rig(side + part)
        toes = rest(f"{side}foot") - rest(f"{side}ankle")
        toe = side + "toe"
        foot = rig(toe) if toe in found else nodes[NODE_INDEX[f"{side}ankle"]] + size * toes
        nodes[NODE_INDEX[f"{side}foot"]] = foot
    return nodes


def _bone_owners(rig: SourceMotion, heads: Array, found: dict[str, int], nodes: Array) -> NDArray[np.int64]:
    """Index of the node that each bone moves with, (B,): a limb's by descent, the trunk's by height."""
    limb = {row: name.replace("toe", "foot") for name, row in found.items() if name.split("_")[-1] != "chest"}
    limb = {row: name for row, name in limb.items() if name == "head" or name.split("_")[-1] in _LIMBS}
    slack = 0.03 * np.ptp(nodes[:, 1])
    owners = np.zeros(len(heads), np.int64)
    for k, parent in enumerate(rig.parents.tolist()):
        if k in limb:
            owners[k] = NODE_INDEX[limb[k]]
        elif parent >= 0 and NODES[owners[parent]] not in _TRUNK:
            owners[k] = owners[parent]
        else:
            below = [n for n in _TRUNK if nodes[NODE_INDEX[n], 1] <= heads[k, 1] + slack]
            owners[k] = NODE_INDEX[below[-1]] if below else NODE_INDEX["pelvis"]
    return owners
