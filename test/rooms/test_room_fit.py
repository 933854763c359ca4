"""One body fitted to the points of two cameras that face each other."""

import numpy as np
import pytest

from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.config import PipelineConfig
from depth_pose.core.labels import BACKGROUND, PERSON
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, NODE_INDEX, Source
from depth_pose.refine import _articulated_kernels as kernels
from depth_pose.refine._tree_kernels import Equations
from depth_pose.refine.body_fitter import BodyFitter
from depth_pose.rooms import _room_kernels
from depth_pose.rooms.rig import RigCamera, look_at
from depth_pose.rooms.room_fit import RoomFit
from depth_pose.rooms.room_refiner import Answer, RoomMemory, RoomRefiner
from depth_pose.rooms.starts import best_limbs
from depth_pose.rooms.view import view_at
from depth_pose.track.person_view import see_people
from depth_pose.track.tracked_person import TrackedPerson

CAMERA = Camera(176, 144, 160.0, 160.0, 87.5, 71.5)
MIDDLE = np.array([0.0, 0.0, 0.95])
"""Pelvis of the person in the room, z up."""
STILL = np.zeros(3)


@pytest.fixture(scope="module")
def bodies(bank):
    return BodyFitter(bank.body)


@pytest.fixture(scope="module")
def pose(bank):
    """The bank's first pose, upright in the room: its model frame has y up."""
    z_up = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    return BodyPose(z_up @ bank.rotations(0), MIDDLE, 1.0)


def camera_at(azimuth: float) -> np.ndarray:
    """``T_room_camera`` of a camera 3 m away, at 1.2 m, that looks at the person."""
    eye = [3.0 * np.sin(azimuth), 1.2, 3.0 * np.cos(azimuth)]
    return RigCamera("camera", CAMERA, look_at(eye, [0.0, 0.95, 0.0])).T_room_camera


def see(bank, pose, T_room_camera, bodies, way=STILL, proposals=False):
    """Render a body of the room into a camera, and take it as somebody found there."""
    rotation = T_room_camera[:3, :3].T
    root = rotation @ (pose.root - way - T_room_camera[:3, 3])
    posed = bank.body.pose(rotation @ pose.rotations, root, pose.scale)
    drawn = render_depth(posed.vertices, bank.body.faces, CAMERA)
    depth = np.where(np.isfinite(drawn), drawn, 0.0).astype(np.float32)
    labels = np.where(depth > 0, PERSON, BACKGROUND).astype(np.uint8)
    found = TrackedPerson(PERSON, "body_1", 1.0)
    if proposals:
        joints = posed.nodes[JOINT_NODES].astype(np.float32)
        sigma = np.full((len(joints), 2), 0.05, np.float32)
        measured = JointMeasurement(joints, sigma, np.ones(len(joints), np.float32))
        found = TrackedPerson(PERSON, "body_1", 1.0, measured)
    (person,) = see_people(0, "", CAMERA, depth, labels, [found]).persons
    return view_at(person, bodies.target(person), T_room_camera, way)


def disturbed(pose, by=0.25):
    """The same pose with bent arms and legs, and shifted."""
    rotations = pose.rotations.copy()
    rng = np.random.default_rng(3)
    for name in ("left_shoulder", "left_elbow", "right_shoulder", "right_elbow", "left_hip", "right_knee"):
        axis = rng.normal(size=3)
        rotations[NODE_INDEX[name]] = (
            rotvec_to_matrix(by * axis / np.linalg.norm(axis)) @ rotations[NODE_INDEX[name]]
        )
    return BodyPose(rotations, pose.root + [0.04, -0.03, 0.02], pose.scale)


def error_mm(fitted: FittedBody, bank, pose):
    truth = bank.body.place(pose.rotations, pose.root, pose.scale)[JOINT_NODES]
    return 1e3 * np.linalg.norm(fitted.nodes[JOINT_NODES] - truth, axis=1)


def fit(bodies, views, start):
    fitter = RoomFit(*bodies.both_of(np.zeros(13, np.float32)), views)
    return fitter.finish(fitter.rough(start))


def test_one_camera_is_fitted_as_in_its_own_frame(bank, bodies, pose):
    view = see(bank, pose, camera_at(0.4), bodies)
    fine, coarse = bodies.both_of(np.zeros(13, np.float32))
    start = disturbed(pose)
    alone = coarse.fit(view.target, view.pose_in_camera(start), coarse.tuning.rough).pose
    there = RoomFit(fine, coarse, [view]).rough(start)
    assert np.allclose(there.pose.root, view.pose_in_room(alone).root, atol=1e-9)
    assert np.allclose(there.pose.rotations, view.pose_in_room(alone).rotations, atol=1e-9)


def test_equations_of_a_camera_turn_to_the_room(bank, bodies, pose):
    """The step of a segment, solved from turned equations, is the turned step."""
    view = see(bank, pose, camera_at(2.0), bodies)
    fine = bodies.of(np.zeros(13, np.float32))
    work, own = (
        kernels.make_workspace(view.target, fine.articulation),
        kernels.make_equations(fine.articulation),
    )
    seen = view.pose_in_camera(disturbed(pose))
    arguments = (view.target, fine.articulation, fine.settings, 0.05, 0, 1.0, seen.rotations, seen.root)
    assert kernels.add_view(*arguments, work, own) > 0.0
    total = Equations(np.zeros_like(own.inertia), np.zeros_like(own.force))
    _room_kernels.add_turned(own, view.rotation, total)
    both = np.kron(np.eye(2), view.rotation)
    segment = int(np.argmax(own.inertia[:, 3, 3]))
    lower = np.tril_indices(6)
    full = own.inertia[segment].copy()
    full[:3, 3:] = full[3:, :3].T
    expected = both.T @ full @ both
    expected[:3, 3:] = 0.0  # the upper right block is not filled
    assert np.allclose(total.inertia[segment][lower], expected[lower])
    assert np.allclose(total.force[segment], both.T @ own.force[segment])


def test_two_cameras_find_what_one_does_not_see(bank, bodies, pose):
    """From one side the other arm and leg are hidden."""
    left, right = (see(bank, pose, camera_at(a), bodies) for a in (0.5 * np.pi, -0.5 * np.pi))
    start = disturbed(pose, 0.15)
    one = error_mm(fit(bodies, [left], start), bank, pose)
    two = error_mm(fit(bodies, [left, right], start), bank, pose)
    hidden = [i for name, i in JOINT_INDEX.items() if name.startswith("right")]
    assert two[hidden].mean() < 0.6 * one[hidden].mean()
    assert two.mean() < 15.0


def test_a_camera_that_looked_earlier_is_moved(bank, bodies, pose):
    """Who walked 6 cm between the two stamps is one body all the same."""
    way = np.array([0.06, 0.0, 0.0])
    early = see(bank, pose, camera_at(np.pi), bodies, way)
    late = see(bank, pose, camera_at(0.0), bodies)
    still = view_at(early.person, early.target, camera_at(np.pi), STILL)
    start = disturbed(pose, 0.0)
    moved = error_mm(fit(bodies, [late, early], start), bank, pose).mean()
    assert moved < 0.6 * error_mm(fit(bodies, [late, still], start), bank, pose).mean()


def test_each_limb_comes_from_the_camera_that_is_surest_of_it(pose):
    other = disturbed(pose)
    sure, unsure = np.full(19, 0.9), np.full(19, 0.5)
    unsure[[JOINT_INDEX[f"left_{n}"] for n in ("shoulder", "elbow", "wrist")]] = 1.0
    mixed = best_limbs([pose, other], [sure, unsure], 1.02)
    arm, leg = NODE_INDEX["left_elbow"], NODE_INDEX["left_hip"]
    assert np.array_equal(mixed.rotations[arm], other.rotations[arm])
    assert np.array_equal(mixed.rotations[leg], pose.rotations[leg])
    assert mixed.scale == 1.02


def test_the_refiner_reports_joints_of_both_cameras(bank, bodies, pose):
    config = PipelineConfig()
    refiner = RoomRefiner(bank, config)
    views = [see(bank, pose, camera_at(a), bodies, proposals=True) for a in (0.2, 2.4)]
    memory = RoomMemory()
    for frame in range(3):
        starts = [disturbed(pose, 0.15), disturbed(pose, -0.2)]
        answers = [Answer(v, s, np.full(19, 0.8)) for v, s in zip(views, starts, strict=True)]
        skeleton = refiner.refine(answers, memory, STILL, frame * 66_000_000, ("room", "person_1"))
    truth = bank.body.place(pose.rotations, pose.root, pose.scale)[JOINT_NODES]
    assert np.linalg.norm(skeleton.positions - truth, axis=1).mean() < 0.02
    assert skeleton.frame_id == "room" and skeleton.body_id == "person_1"
    assert skeleton.source == Source.REFINED
    assert skeleton.joint_confidence.min() > 0.5
    assert memory.turn == 3
