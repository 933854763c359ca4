import sys

import numpy as np
import pytest

from depth_pose.body.bodies import find_body
from depth_pose.body.body import keep_largest
from depth_pose.body.files import load_body, save_body
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.skeleton import NODES, rest_nodes


def test_body_file(body, tmp_path):
    save_body(body, tmp_path / "mine.npz")
    again = find_body(str(tmp_path / "mine.npz"))
    assert again.content_hash() == body.content_hash()
    assert again.name == "mine"


def test_scaled_to_the_reference(body, tmp_path):
    arrays = {n: getattr(body, n) for n in ("vertices", "faces", "weights", "nodes")}
    small = arrays | {"vertices": 0.6 * body.vertices, "nodes": 0.6 * body.nodes}
    np.savez(tmp_path / "small.npz", **small, stature=0.6 * body.stature)
    np.testing.assert_allclose(load_body(tmp_path / "small.npz").nodes, body.nodes, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"weights": None}, "weights is missing"),
        ({"nodes": np.zeros((19, 3))}, r"nodes is float64\[19, 3\]"),
        ({"faces": np.array([[0, 1, 99999]])}, "indices of vertices that do not exist"),
        ({"weights": "zero"}, "no row may be all zero"),
        ({"vertices": "mm"}, "unit must be metres"),
    ],
)
def test_refused(body, tmp_path, change, says):
    arrays = {n: getattr(body, n) for n in ("vertices", "faces", "weights", "nodes")}
    for name, value in change.items():
        if value is None:
            del arrays[name]
        elif isinstance(value, str):
            arrays[name] = arrays[name] * (1000.0 if value == "mm" else 0.0)
        else:
            arrays[name] = value
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(InputError, match=says):
        load_body(tmp_path / "bad.npz")


def test_unknown_body(tmp_path):
    with pytest.raises(ConfigError, match="no body 'cube'"):
        find_body("cube")
    with pytest.raises(InputError, match=r"none\.npz cannot be read"):
        find_body(str(tmp_path / "none.npz"))


def test_keep_largest():
    weights = np.random.default_rng(0).random((50, 21))
    kept = keep_largest(weights)
    np.testing.assert_allclose(kept.sum(axis=1), 1.0)
    assert ((kept > 0).sum(axis=1) == 4).all()
    assert (np.argmax(kept, axis=1) == np.argmax(weights, axis=1)).all()


def test_anny_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "anny", None)
    with pytest.raises(ConfigError, match=r"pip install 'depth_pose\[anny\]'"):
        find_body("anny")


@pytest.mark.slow
def test_shapes_of_anny_share_their_faces_and_differ():
    pytest.importorskip("anny", reason="the extra 'anny' is not installed")
    from depth_pose.body.anny_body import AnnyShape, make_anny_body

    average, heavy = make_anny_body(), make_anny_body(AnnyShape(weight=1.0, muscle=0.2, age=1.0))
    np.testing.assert_array_equal(average.faces, heavy.faces)
    same = make_anny_body(AnnyShape())  # its own vertices, not those that the decimation moved
    moved = np.linalg.norm(same.vertices - average.vertices, axis=1)
    assert np.median(moved) < 0.003
    assert moved.max() < 0.04
    assert np.ptp(heavy.vertices[:, 2]) > np.ptp(average.vertices[:, 2]) + 0.03


@pytest.mark.slow
def test_anny_is_a_body_in_our_rest_pose():
    pytest.importorskip("anny", reason="the extra 'anny' is not installed")
    found = find_body("anny")
    assert len(found.vertices) <= 3000
    assert np.ptp(found.vertices[:, 1]) == pytest.approx(1.75)
    # every bone is as long as the joint definition says, and points there
    wanted = rest_nodes() * 1.75
    for n, parent in (("elbow", "shoulder"), ("wrist", "elbow"), ("knee", "hip"), ("ankle", "knee")):
        for side in ("left_", "right_"):
            a, b = NODES.index(side + parent), NODES.index(side + n)
            np.testing.assert_allclose(found.nodes[b] - found.nodes[a], wanted[b] - wanted[a], atol=0.015)
    triangles = found.vertices[found.faces]
    volume = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    assert 0.05 < volume < 0.08  # outward faces; about 65 litres
    raised = np.tile(np.eye(3), (21, 1, 1))
    side = [i for i, name in enumerate(NODES) if name in ("left_shoulder", "left_elbow", "left_wrist")]
    raised[side] = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # a quarter up
    moved = found.pose(raised, found.nodes[0])
    assert moved.nodes[NODES.index("left_wrist"), 1] > found.nodes[NODES.index("head"), 1]
