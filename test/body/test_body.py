"""The embedded body: soundness of its mesh, its weights, and how it is posed."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.body.body import INFLUENCES, Body
from depth_pose.body.procedural import BodyShape, make_body
from depth_pose.core.errors import ConfigError
from depth_pose.core.rotations import rotation_x, rotation_z
from depth_pose.core.skeleton import MIRROR_NODES, NODE_INDEX, NODE_PARENTS, forward_kinematics, rest_nodes


@pytest.fixture(scope="module")
def body() -> Body:
    return make_body()


def skin_slowly(body: Body, rotations, root, scale):
    """Plain-numpy twin of the skinning kernel."""
    nodes = forward_kinematics(rotations, root, body.nodes, scale)
    local = body.vertices[:, None, :] - body.nodes
    moved = scale * np.einsum("nij,vnj->vni", rotations, local) + nodes
    return np.einsum("vn,vni->vi", body.weights, moved), nodes


def random_rotations(rng: np.random.Generator, count: int) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    q = q * np.sign(np.einsum("nii->ni", r))[:, None, :]
    return q * np.linalg.det(q)[:, None, None]


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    p = vertices[faces]
    return float(np.einsum("ij,ij->", p[:, 0], np.cross(p[:, 1], p[:, 2])) / 6.0)


def test_mesh_is_one_watertight_sphere_like_surface(body: Body) -> None:
    directed = np.concatenate([body.faces[:, [0, 1]], body.faces[:, [1, 2]], body.faces[:, [2, 0]]])
    assert len(np.unique(directed, axis=0)) == len(directed)
    edges, times = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    assert (times == 2).all()
    assert len(body.vertices) - len(edges) + len(body.faces) == 2
    assert 1500 <= len(body.vertices) <= 3000
    assert len(np.unique(body.faces)) == len(body.vertices)


def test_volume_is_that_of_an_adult_and_faces_look_outwards(body: Body) -> None:
    assert 0.055 < signed_volume(body.vertices, body.faces) < 0.085


def test_stands_on_the_floor_at_its_stature(body: Body) -> None:
    assert body.vertices[:, 1].min() == pytest.approx(0.0, abs=1e-6)
    assert body.vertices[:, 1].max() == pytest.approx(1.75, abs=1e-6)
    offset = body.nodes - rest_nodes() * 1.75
    np.testing.assert_allclose(offset, np.tile(offset[0], (21, 1)), atol=1e-12)


def test_left_and_right_are_mirror_images(body: Body) -> None:
    order = np.lexsort(body.vertices.round(9).T)
    flipped = body.vertices * [-1.0, 1.0, 1.0]
    other = np.lexsort((flipped + 0.0).round(9).T)
    np.testing.assert_allclose(body.vertices[order], flipped[other], atol=1e-9)
    np.testing.assert_allclose(body.weights[order], body.weights[other][:, MIRROR_NODES], atol=1e-9)


def test_vertices_are_spread_evenly(body: Body) -> None:
    p = body.vertices[body.faces]
    sides = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2)
    assert sides.max() < 0.065
    assert np.median(sides) == pytest.approx(0.031, abs=0.005)
    for name, radius, least in (("left_wrist", 0.2, 60), ("left_foot", 0.2, 60), ("head", 0.15, 120)):
        near = np.linalg.norm(body.vertices - body.nodes[NODE_INDEX[name]], axis=1) < radius
        assert near.sum() >= least


def test_joints_lie_inside_the_body(body: Body) -> None:
    p = body.vertices[body.faces][None] - body.nodes[:, None, None]
    length = np.linalg.norm(p, axis=-1)
    a, b, c = p[:, :, 0], p[:, :, 1], p[:, :, 2]
    triple = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
    la, lb, lc = length[..., 0], length[..., 1], length[..., 2]
    below = (
        la * lb * lc
        + np.einsum("nfi,nfi->nf", a, b) * lc
        + np.einsum("nfi,nfi->nf", b, c) * la
        + np.einsum("nfi,nfi->nf", c, a) * lb
    )
    winding = (2.0 * np.arctan2(triple, below)).sum(axis=1) / (4.0 * np.pi)
    feet = [NODE_INDEX["left_foot"], NODE_INDEX["right_foot"]]
    assert (np.delete(winding, feet) > 0.5).all()


def test_weights_are_few_and_sum_to_one(body: Body) -> None:
    np.testing.assert_allclose(body.weights.sum(axis=1), 1.0, atol=1e-12)
    assert (body.weights >= 0).all()
    assert int((body.weights > 0).sum(axis=1).max()) <= INFLUENCES


def test_each_part_moves_with_its_own_segment(body: Body) -> None:
    for name, at, least in (
        ("left_wrist", body.nodes[NODE_INDEX["left_wrist"]] + [0.07, -0.07, 0.0], 50),
        (
            "left_elbow",
            0.5 * (body.nodes[NODE_INDEX["left_elbow"]] + body.nodes[NODE_INDEX["left_wrist"]]),
            10,
        ),
        ("left_knee", 0.5 * (body.nodes[NODE_INDEX["left_knee"]] + body.nodes[NODE_INDEX["left_ankle"]]), 10),
        ("left_ankle", body.nodes[NODE_INDEX["left_foot"]], 30),
        ("head", np.array([0.0, 1.67, 0.03]), 60),
    ):
        near = np.linalg.norm(body.vertices - at, axis=1) < 0.10
        assert near.sum() >= least
        assert body.weights[near, NODE_INDEX[name]].mean() > 0.8


def test_weights_never_cross_to_the_other_limb(body: Body) -> None:
    left_leg = body.weights[:, [NODE_INDEX[f"left_{n}"] for n in ("knee", "ankle")]].sum(axis=1)
    assert (left_leg[body.vertices[:, 0] < 0] == 0).all()
    arm = body.weights[:, [NODE_INDEX[f"left_{n}"] for n in ("elbow", "wrist")]].sum(axis=1)
    assert (arm[body.vertices[:, 0] < 0.2] == 0).all()


def test_rest_pose_gives_the_rest_mesh(body: Body) -> None:
    posed = body.pose(np.tile(np.eye(3), (21, 1, 1)), body.nodes[0])
    np.testing.assert_allclose(posed.vertices, body.vertices, atol=1e-12)
    np.testing.assert_allclose(posed.nodes, body.nodes, atol=1e-12)


def test_kernel_agrees_with_numpy(body: Body) -> None:
    rng = np.random.default_rng(3)
    rotations, root = random_rotations(rng, 21), rng.normal(size=3)
    posed = body.pose(rotations, root, 0.8)
    vertices, nodes = skin_slowly(body, rotations, root, 0.8)
    np.testing.assert_allclose(posed.vertices, vertices, atol=1e-12)
    np.testing.assert_allclose(posed.nodes, nodes, atol=1e-12)


def test_rigid_motion_moves_the_body_rigidly(body: Body) -> None:
    rng = np.random.default_rng(4)
    rotations, root = random_rotations(rng, 21), rng.normal(size=3)
    turn, shift = random_rotations(rng, 1)[0], rng.normal(size=3)
    before = body.pose(rotations, root)
    after = body.pose(turn @ rotations, turn @ root + shift)
    np.testing.assert_allclose(after.vertices, before.vertices @ turn.T + shift, atol=1e-12)


def test_bent_knee_keeps_its_volume(body: Body) -> None:
    rotations = np.tile(np.eye(3), (21, 1, 1))
    bend = rotation_x(np.radians(120.0))
    for name in ("left_knee", "left_ankle", "left_foot"):
        rotations[NODE_INDEX[name]] = bend
    posed = body.pose(rotations, body.nodes[0])
    loss = signed_volume(posed.vertices, body.faces) / signed_volume(body.vertices, body.faces)
    assert 0.97 < loss < 1.03


@pytest.mark.parametrize(
    "shape",
    [
        BodyShape(stature_m=1.2, head_size=1.25),
        BodyShape(girth=1.2, hip_width=1.1),
        BodyShape(leg_length=1.06, arm_length=0.95, trunk_length=0.97, shoulder_width=1.1),
    ],
)
def test_builds_share_topology_and_stature_holds(body: Body, shape: BodyShape) -> None:
    other = make_body(shape)
    np.testing.assert_array_equal(other.faces, body.faces)
    np.testing.assert_array_equal(other.weights, body.weights)
    assert np.ptp(other.vertices[:, 1]) == pytest.approx(shape.stature_m, abs=1e-9)
    assert other.vertices[:, 1].min() == pytest.approx(0.0, abs=1e-9)
    assert other.content_hash() != body.content_hash()


def test_a_larger_person_is_the_same_person_scaled(body: Body) -> None:
    tall = make_body(BodyShape(stature_m=2.0))
    np.testing.assert_allclose(tall.vertices, body.vertices * (2.0 / 1.75), atol=1e-9)
    np.testing.assert_allclose(tall.nodes, body.nodes * (2.0 / 1.75), atol=1e-9)


def test_girth_thickens_and_trunk_depth_only_deepens_the_trunk(body: Body) -> None:
    thick = make_body(BodyShape(girth=1.1))
    grown = signed_volume(thick.vertices, body.faces) / signed_volume(body.vertices, body.faces)
    assert 1.12 < grown < 1.23
    np.testing.assert_allclose(make_body(BodyShape(girth=1.1)).nodes[:, 1], body.nodes[:, 1], atol=0.01)
    deep = make_body(BodyShape(trunk_depth=1.2))
    moved = np.abs(deep.vertices - body.vertices)
    arm = body.weights[:, NODE_INDEX["left_elbow"]] > 0.99
    chest = (body.weights[:, NODE_INDEX["chest"]] > 0.7) & (body.vertices[:, 2] > 0.05)
    assert moved[arm].max() < 0.005
    assert deep.vertices[chest, 2].mean() > body.vertices[chest, 2].mean() + 0.015


def test_bank_of_poses_never_tears_the_skin(body: Body) -> None:
    rest = body.vertices[body.faces]
    rest_sides = np.linalg.norm(rest - np.roll(rest, 1, axis=1), axis=2)
    for name, angle in (("left_hip", -100.0), ("left_knee", 120.0), ("left_shoulder", 90.0), ("head", 40.0)):
        rotations = np.tile(np.eye(3), (21, 1, 1))
        chain = [i for i in range(21) if i == NODE_INDEX[name] or NODE_PARENTS[i] == NODE_INDEX[name]]
        chain += [i for i in range(21) if NODE_PARENTS[i] in chain and i not in chain]
        rotations[chain] = (rotation_z if "shoulder" in name else rotation_x)(np.radians(angle))
        posed = body.pose(rotations, body.nodes[0]).vertices[body.faces]
        sides = np.linalg.norm(posed - np.roll(posed, 1, axis=1), axis=2)
        assert (sides / rest_sides).max() < 3.5


def test_impossible_shape_is_refused() -> None:
    with pytest.raises(ConfigError, match="girth"):
        BodyShape(girth=0.0)


def test_body_refuses_weights_that_do_not_sum_to_one(body: Body) -> None:
    with pytest.raises(ValueError, match="sum to 1"):
        Body("bad", body.vertices, body.faces, body.weights * 0.5, body.nodes, 1.75)


def test_vertex_normals_point_outward(body: Body) -> None:
    normals = body.normals
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    grown = signed_volume(body.vertices + 0.002 * normals, body.faces)
    assert grown > signed_volume(body.vertices, body.faces) > 0.04
