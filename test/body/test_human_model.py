"""REP-155's model of a person: the URDF, read again by itself, stands as the angles say."""

from xml.etree import ElementTree

import numpy as np
import pytest

from depth_pose.body.build import BuildSpace
from depth_pose.body.human_model import JOINTS, LINKS, Sizes, make_urdf, posture_of
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL, matrix_to_quat, rotvec_to_matrix
from depth_pose.core.skeleton import JOINT_NODES, NODE_INDEX, rest_nodes
from depth_pose.motion.procedural.generator import make_poses
from skeletons import make_skeleton

SPHERICAL = ("{}_y_shoulder", "{}_p_shoulder", "{}_shoulder", "{}_elbow", "{}_wrist")
LEG = ("{}_y_hip", "{}_p_hip", "{}_hip", "{}_knee", "{}_ankle")


def numbers(element, key, default="0 0 0"):
    return np.array(
        [float(v) for v in element.get(key, default).split()] if element is not None else [0.0] * 3
    )


def stand(urdf, values, base):
    """Where each link of a URDF lies: a small robot_state_publisher."""
    robot = ElementTree.fromstring(urdf)
    places = {robot.find("link").get("name"): base}
    for joint in robot.iter("joint"):
        T = np.eye(4)
        T[:3, 3] = numbers(joint.find("origin"), "xyz")
        if joint.get("type") == "revolute":
            axis = numbers(joint.find("axis"), "xyz")
            T[:3, :3] = rotvec_to_matrix(axis * values[joint.get("name")])
        parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
        places[child] = places[parent] @ T
    return places


def skeleton_of(posed, rotations):
    return make_skeleton(posed.nodes[JOINT_NODES], quats_xyzw=matrix_to_quat(rotations[JOINT_NODES]))


@pytest.fixture(scope="module")
def people(body):
    """Skeletons of people of several builds and scales in many poses, and their sizes."""
    space, rng, out = BuildSpace(body), np.random.default_rng(5), []
    for k, rotations in enumerate(make_poses(60, seed=3).rotations):
        build = (0.05 * rng.standard_normal(13)).astype(np.float32)
        person, scale = space.body(build), 0.8 + 0.01 * (k % 40)
        turned = R_CAMERA_FACING_MODEL @ rotations
        posed = person.pose(turned, np.array([0.1, 0.2, 3.0]), scale)
        out.append((skeleton_of(posed, turned), Sizes.of(person.nodes, scale)))
    return out


def test_names_are_those_of_rep_155():
    robot = ElementTree.fromstring(make_urdf("ab1", Sizes.of(1.75 * rest_nodes(), 1.0)))
    links = {e.get("name") for e in robot.iter("link")}
    sides = [part.format(side) for side in "lr" for part in (*SPHERICAL, *LEG)]
    heads = ("r_head", "y_head", "p_head", "head")
    assert links == {f"{n}_ab1" for n in ("body", "waist", "torso", *heads, *sides)}
    kinds = {e.get("name"): e.get("type") for e in robot.iter("joint")}
    fixed = ("torso", "head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
    assert {n for n, kind in kinds.items() if kind == "fixed"} == {f"{n}_ab1" for n in fixed}
    assert {n for n, kind in kinds.items() if kind == "revolute"} == {f"{n}_ab1" for n in JOINTS}
    assert {f"{n}_ab1" for n in LINKS} <= links


def test_limbs_of_the_urdf_point_as_the_person_s(people):
    for skeleton, sizes in people:
        posture = posture_of(skeleton, sizes)
        values = {f"{n}_7": a for n, a in zip(JOINTS, posture.angles, strict=True)}
        places = stand(make_urdf("7", sizes), values, posture.frames[0])
        measured = {name: T for name, T in zip(LINKS, posture.frames, strict=True)}
        for side in "lr":
            for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle")):
                bone = places[f"{side}_{b}_7"][:3, 3] - places[f"{side}_{a}_7"][:3, 3]
                want = measured[f"{side}_{b}"][:3, 3] - measured[f"{side}_{a}"][:3, 3]
                assert np.allclose(bone, want, atol=2e-4), (side, a, b)
            for part in ("hip", "knee", "ankle"):  # below the trunk nothing is lost
                assert np.linalg.norm((places[f"{side}_{part}_7"] - measured[f"{side}_{part}"])[:3, 3]) < 0.02
        assert np.allclose(places["head_7"][:3, :3], measured["head"][:3, :3], atol=1e-3)


def test_the_trunk_s_twist_is_what_is_lost(people):
    off = []
    for skeleton, sizes in people:
        posture = posture_of(skeleton, sizes)
        values = {f"{n}_7": a for n, a in zip(JOINTS, posture.angles, strict=True)}
        places = stand(make_urdf("7", sizes), values, posture.frames[0])
        off.append(
            [
                np.linalg.norm((places[f"{n}_7"] - T)[:3, 3])
                for n, T in zip(LINKS, posture.frames, strict=True)
            ]
        )
    mean = dict(zip(LINKS, np.mean(off, 0), strict=True))
    assert mean["torso"] < 0.04 and mean["head"] < 0.05
    assert max(mean.values()) < 0.05  # docs/topics.md: shoulders and arms by 40 mm on average


def test_the_standing_posture_is_zero(body):
    """Arms hanging, facing the camera: x forward is the camera's -z, z up its -y."""
    from depth_pose.body.angles import N_ANGLES, rotations_from_angles

    rotations = R_CAMERA_FACING_MODEL @ rotations_from_angles(np.zeros(N_ANGLES))
    posed = body.pose(rotations, np.array([0.0, 0.0, 3.0]))
    posture = posture_of(skeleton_of(posed, rotations), Sizes.of(body.nodes, 1.0))
    values = dict(zip(JOINTS, posture.angles, strict=True))
    assert abs(values["waist"]) < 0.02 and abs(values["l_elbow"]) < 0.05 and abs(values["r_knee"]) < 0.05
    for name in ("p_shoulder", "p_hip", "r_hip"):
        assert abs(values[f"l_{name}"]) < 0.12 and abs(values[f"r_{name}"]) < 0.12
    for T in posture.frames:
        assert np.allclose(T[:3, 0], [0, 0, -1], atol=0.15) and np.allclose(T[:3, 2], [0, -1, 0], atol=0.15)
    left, right = (posture.frames[LINKS.index(f"{s}_wrist")][:3, 3] for s in "lr")
    assert left[0] > right[0]  # the person's left is on the image's right


def test_new_sizes(body):
    a = Sizes.of(body.nodes, 1.0)
    assert a.is_like(Sizes.of(body.nodes, 1.01)) and not a.is_like(Sizes.of(body.nodes, 1.05))
    assert a.thigh == pytest.approx(
        np.linalg.norm(body.nodes[NODE_INDEX["left_knee"]] - body.nodes[NODE_INDEX["left_hip"]])
    )
