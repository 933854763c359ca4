"""Rigged humans from glTF files that the tests write: other axes, units, pose and bones than ours."""

from __future__ import annotations

import base64
import json
import struct

import numpy as np
import pytest
from scipy.spatial import cKDTree

from depth_pose.body.bodies import find_body
from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import NODE_INDEX, NODES
from gltf_writer import document_of, write_glb


@pytest.fixture(scope="module")
def loaded(body, tmp_path_factory):
    path = tmp_path_factory.mktemp("gltf") / "someone.glb"
    write_glb(path, *document_of(body))
    return find_body(str(path))


def test_the_same_body_comes_back(body, loaded):
    """Our own body, exported with level arms, is bent back and stands where ours does."""
    assert (loaded.name, loaded.stature) == ("someone", body.stature)
    limbs = [i for i, n in enumerate(NODES) if n.split("_")[-1] not in ("spine", "chest", "neck", "clavicle")]
    gaps = np.linalg.norm((loaded.nodes - loaded.nodes[0]) - (body.nodes - body.nodes[0]), axis=1)
    assert gaps[limbs].max() < 0.02
    assert gaps.max() < 0.04
    distance = cKDTree(body.vertices).query(loaded.vertices + body.nodes[0] - loaded.nodes[0])[0]
    assert np.percentile(distance, 95) < 0.03
    near = cKDTree(body.vertices).query(loaded.vertices)[1]
    strongest = np.argmax(loaded.weights, axis=1) == np.argmax(body.weights, axis=1)[near]
    assert strongest.mean() > 0.75


def test_a_finger_moves_with_the_hand_and_sides_are_ours(loaded):
    hand = loaded.weights[:, NODE_INDEX["left_wrist"]] > 0.5
    assert hand.sum() > 20
    assert loaded.vertices[hand, 0].min() > 0.2
    assert loaded.nodes[NODE_INDEX["left_foot"], 2] > loaded.nodes[NODE_INDEX["left_ankle"], 2]


def test_text_form_with_the_data_inside(body, loaded, tmp_path):
    document, data = document_of(body)
    uri = "data:application/gltf-buffer;base64," + base64.b64encode(data).decode()
    (tmp_path / "someone.gltf").write_text(
        json.dumps(document | {"buffers": [{"uri": uri, "byteLength": len(data)}]})
    )
    assert find_body(str(tmp_path / "someone.gltf")).content_hash() == loaded.content_hash()


def test_data_beside_the_file(body, loaded, tmp_path):
    document, data = document_of(body)
    path = tmp_path / "someone.gltf"
    path.write_text(json.dumps(document | {"buffers": [{"uri": "data.bin", "byteLength": len(data)}]}))
    with pytest.raises(InputError, match=r"cannot be read as glTF.*data\.bin"):
        find_body(str(path))
    (tmp_path / "data.bin").write_bytes(data)
    assert find_body(str(path)).content_hash() == loaded.content_hash()


def test_refused(body, tmp_path):
    path = tmp_path / "bad.glb"
    path.write_bytes(b"glTF")
    with pytest.raises(InputError, match="cannot be read as glTF"):
        find_body(str(path))
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12))
    with pytest.raises(InputError, match="cannot be read as glTF"):
        find_body(str(path))
    document, data = document_of(body)
    write_glb(path, document | {"nodes": document["nodes"][:-1]}, data)
    with pytest.raises(InputError, match="no skinned mesh"):
        find_body(str(path))
    write_glb(path, *document_of(body, lambda name: name.replace("ForeArm", "Thing")))
    with pytest.raises(InputError, match="no joint for the left elbow"):
        find_body(str(path))
    write_glb(path, document, data[: len(data) // 2])
    with pytest.raises(InputError, match="cannot be read as glTF"):
        find_body(str(path))


def as_text(path, document, data):
    uri = "data:application/gltf-buffer;base64," + base64.b64encode(data).decode()
    buffers = document.get("buffers", [{"uri": uri, "byteLength": len(data)}])
    path.write_text(json.dumps(document | {"buffers": buffers}))
    return str(path)


def test_buffers_outside_of_the_folder_are_not_read(body, tmp_path):
    document, data = document_of(body)
    (tmp_path / "secret.bin").write_bytes(data)
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link.bin").symlink_to(tmp_path / "secret.bin")
    (inside / "endless.bin").symlink_to("/dev/zero")
    for uri in ("../secret.bin", "link.bin", "%2e%2e/secret.bin", str(tmp_path / "secret.bin"), "/dev/zero",
                "endless.bin", "file:///dev/zero"):  # fmt: skip
        spoiled = document | {"buffers": [{"uri": uri, "byteLength": len(data)}]}
        with pytest.raises(InputError, match=r"outside of its folder|No such file"):
            find_body(as_text(inside / "a.gltf", spoiled, data))
    (inside / "own.bin").write_bytes(data)
    document |= {"buffers": [{"uri": "own.bin", "byteLength": len(data)}]}
    assert len(find_body(as_text(inside / "a.gltf", document, data)).faces)


def test_nodes_in_a_circle_and_arrays_without_end_are_refused(body, tmp_path):
    document, data = document_of(body)
    circle = json.loads(json.dumps(document))
    first = len(circle["nodes"])
    circle["nodes"] += [{"children": [first + 1, 0]}, {"children": [first]}]
    with pytest.raises(InputError, match="circle"):
        find_body(as_text(tmp_path / "a.gltf", circle, data))
    long = json.loads(json.dumps(document))
    long["accessors"][0]["count"] = 2**40
    with pytest.raises(InputError, match="too long"):
        find_body(as_text(tmp_path / "a.gltf", long, data))
    many = json.loads(json.dumps(document))
    many["meshes"][0]["primitives"] *= 2000
    with pytest.raises(InputError, match="vertices; make its mesh coarser"):
        find_body(as_text(tmp_path / "a.gltf", many, data))
