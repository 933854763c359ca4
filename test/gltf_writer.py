"""Rigged humans as glTF files: other axes, units, pose and bones than ours."""

from __future__ import annotations

import json
import struct

import numpy as np

from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import NODE_INDEX, NODE_PARENTS, NODES

NAMES = {
    "pelvis": "Hips", "spine": "Spine", "chest": "Spine2", "neck": "Neck", "head": "Head",
    "clavicle": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand",
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase",
}  # fmt: skip
TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Their z is up and their x forward."""


def bone_name(node):
    side, _, part = node.rpartition("_")
    return f"mixamorig:{side.capitalize()}{NAMES[part]}"


def arms_out(body):
    """Posed vertices and nodes with the arms level, as in most rigs."""
    rotations = np.tile(np.eye(3), (len(NODES), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for part in ("shoulder", "elbow", "wrist"):
            rotations[NODE_INDEX[f"{side}_{part}"]] = rotvec_to_matrix(np.array([0.0, 0.0, sign * np.pi / 4]))
    return body.pose(rotations, body.nodes[0])


class Buffer:
    """Collects arrays and their accessors."""

    def __init__(self):
        self.data, self.views, self.accessors = b"", [], []

    def add(self, array, component, kind, normalized=False):
        self.data += b"\0" * (-len(self.data) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes})
        self.data += array.tobytes()
        accessor = {"bufferView": len(self.views) - 1, "componentType": component, "type": kind}
        self.accessors.append(accessor | {"count": len(array)} | ({"normalized": True} if normalized else {}))
        return len(self.accessors) - 1


def document_of(body, rename=lambda name: name):
    """A glTF document and its buffer: centimetres, every triangle with vertices of its own."""
    posed, buffer = arms_out(body), Buffer()
    vertices, heads = 100.0 * posed.vertices @ TURN.T, 100.0 * posed.nodes @ TURN.T
    corners = body.faces.ravel()
    order = np.argsort(-body.weights, axis=1, kind="stable")[:, :4]
    weights = np.take_along_axis(body.weights, order, axis=1)
    finger = len(NODES)  # one more bone, below the left wrist
    bones = np.where(order == NODE_INDEX["left_wrist"], finger, order)
    inverse = np.tile(np.eye(4), (len(NODES) + 1, 1, 1))
    inverse[:, :3, 3] = -np.concatenate([heads, heads[[NODE_INDEX["left_wrist"]]] + 5.0])
    attributes = {
        "POSITION": buffer.add(vertices[corners].astype("<f4"), 5126, "VEC3"),
        "JOINTS_0": buffer.add(bones[corners].astype("<u1"), 5121, "VEC4"),
        "WEIGHTS_0": buffer.add(np.round(65535 * weights[corners]).astype("<u2"), 5123, "VEC4", True),
    }
    matrices = buffer.add(inverse.transpose(0, 2, 1).astype("<f4").reshape(-1, 16), 5126, "MAT4")
    nodes = [{"name": rename(bone_name(n)), "children": []} for n in NODES]
    for child, parent in enumerate(NODE_PARENTS[1:].tolist(), 1):
        nodes[parent]["children"].append(child)
    nodes[NODE_INDEX["left_wrist"]]["children"].append(finger)
    nodes += [{"name": "mixamorig:LeftHandIndex1"}, {"mesh": 0, "skin": 0}]
    document = {
        "asset": {"version": "2.0"},
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": attributes}]}],
        "skins": [{"joints": list(range(finger + 1)), "inverseBindMatrices": matrices}],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
    }
    return document, buffer.data


def write_glb(path, document, data):
    text = json.dumps(document | {"buffers": [{"byteLength": len(data)}]}).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
