"""The articulated fit: known poses are found again; its terms against plain sums and differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from depth_pose.body import _nearest_kernels as nearest_kernels
from depth_pose.body.feet import heel_vertices
from depth_pose.body.pose import BodyPose
from depth_pose.body.rendered_depth import Observation
from depth_pose.core._rotation_kernels import rotation_of
from depth_pose.core.labels import BACKGROUND, PERSON, UNKNOWN
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.pose_match import Candidate
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.core.skeleton import JOINT_NODES, JOINTS, MIRROR_JOINTS, NODE_INDEX, NODE_PARENTS
from depth_pose.refine import _articulated_kernels as kernels
from depth_pose.refine import _tree_kernels as tree
from depth_pose.refine import _visibility_kernels as visibility
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.refine.tuning import FitTuning
from depth_pose.track.tracked_person import TrackedPerson

LIMBS = [f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "hip", "knee")]


@pytest.fixture(scope="module")
def fitter(body):
    return ArticulatedFitter(body)


def disturbed(rotations, seed, degrees, names=("spine", *LIMBS)):
    """Turn whole limbs by an angle about random axes."""
    rng = np.random.default_rng(seed)
    out = rotations.copy()
    for name in names:
        axis = rng.standard_normal(3)
        below = syn.subtree(NODE_INDEX[name])
        out[below] = rotvec_to_matrix(np.radians(degrees) * axis / np.linalg.norm(axis)) @ out[below]
    return out


def target_of(posed_body, noise=0.0):
    depth = syn.draw(syn.mesh(posed_body))
    depth = depth + noise * np.random.default_rng(0).standard_normal(depth.shape)
    person = syn.to_person(depth)
    return person.target(800)


def proposed(joints, confidence):
    """A person whose joints the finder proposes."""
    sigma = np.sqrt(1.0 / np.clip(confidence, 0.01, 0.99) - 1.0) * 0.1 / 1.6
    deviations = np.repeat(sigma[:, None], 2, axis=1).astype(np.float32)
    measured = JointMeasurement(joints.astype(np.float32), deviations, confidence.astype(np.float32))
    return TrackedPerson(1, "body_1", 1.0, measured)


def fit_pose(fitter, *given):
    return fitter.fit(*given).pose


def nodes_of(body, pose):
    return body.pose(pose.rotations, pose.root, pose.scale).nodes


# --- the fit as a whole


@pytest.mark.parametrize("swapped", [False, True])
def test_joints_that_nobody_sees_go_where_they_are_proposed(body, fitter, swapped):
    """Legs below the image's border: bent at the start, straight in truth; names of sides do not matter."""
    posed = syn.posed(syn.arms_down(), distance=2.8)
    depth = syn.draw(syn.mesh(posed))
    depth[depth.shape[0] // 2 :] = 0.0
    person = syn.to_person(depth)
    truth = posed.nodes[JOINT_NODES]
    proposals = proposed(truth[MIRROR_JOINTS] if swapped else truth, np.ones(len(JOINTS)))
    bent = syn.FACING @ syn.arms_down()
    for name in ("left_hip", "right_hip"):
        below = syn.subtree(NODE_INDEX[name])
        bent[below] = rotvec_to_matrix(np.array([0.5, 0.0, 0.0])) @ bent[below]
    start = BodyPose(bent, posed.nodes[0], 1.0)
    legs = [NODE_INDEX[n] for n in ("left_knee", "right_knee", "left_ankle", "right_ankle")]
    errors = []
    for with_proposals in (False, True):
        target = replace(person, found=proposals).target(800, with_proposals=with_proposals)
        fitted = nodes_of(body, fit_pose(fitter, target, start, fitter.tuning.sigmas + 10 * (0.02,)))
        errors.append(np.linalg.norm(fitted - posed.nodes, axis=1)[legs].mean())
    assert errors[0] > 0.1
    assert errors[1] < 0.3 * errors[0]


def test_proposals_far_from_the_truth_do_little(body, fitter):
    posed, start = disturbed_start(1, 10.0)
    depth = syn.draw(syn.mesh(posed))
    person = syn.to_person(depth)
    wrong = posed.nodes[JOINT_NODES] + [0.0, 0.0, 0.6]
    plain = person.target(800, with_proposals=False)
    misled = replace(person, found=proposed(wrong, np.ones(len(JOINTS)))).target(800)
    fits = [nodes_of(body, fit_pose(fitter, t, start)) for t in (plain, misled)]
    assert syn.joint_error(fits[1], fits[0]) < 0.01


@pytest.mark.parametrize("swapped", [False, True])
def test_heels_that_nobody_sees_go_where_they_are_proposed(body, fitter, swapped):
    """On the toes, below the image's border, the balls unknown; names of sides do not matter."""
    rotations = syn.arms_down()
    for side in ("left", "right"):
        below = syn.subtree(NODE_INDEX[f"{side}_ankle"])
        rotations[below] = rotvec_to_matrix(np.array([0.7, 0.0, 0.0])) @ rotations[below]
    posed = syn.posed(rotations, distance=2.8)
    depth = syn.draw(syn.mesh(posed))
    depth[depth.shape[0] // 2 :] = 0.0
    person = syn.to_person(depth)
    truth = posed.nodes[JOINT_NODES]
    sure = np.array(["foot" not in name for name in JOINTS]).astype(float)
    found = proposed(truth[MIRROR_JOINTS] if swapped else truth, sure)
    heels = posed.vertices[heel_vertices(body)]
    named = np.column_stack([heels[::-1] if swapped else heels, np.full((2, 2), 0.01)]).astype(np.float32)
    start = BodyPose(syn.FACING @ syn.arms_down(), posed.nodes[0], 1.0)
    away = []
    for one in (found, replace(found, measured=replace(found.measured, heels=named))):
        pose = fit_pose(fitter, replace(person, found=one).target(800), start, 20 * (0.06,))
        fitted = body.pose(pose.rotations, pose.root, pose.scale).vertices[heel_vertices(body)]
        away.append(np.linalg.norm(fitted - heels, axis=1).max())
    print(away)
    assert away[1] < 0.75 * away[0]


@pytest.mark.parametrize("raised", [0.0, 0.03, -0.03])
def test_soles_stand_on_a_floor_that_is_known(body, fitter, raised):
    """Feet hidden by something, so that only the floor tells their height; far from it, it does nothing."""
    posed = syn.posed(syn.arms_down(), distance=2.8)
    depth = syn.draw(syn.mesh(posed))
    hidden = np.zeros(depth.shape, np.bool_)
    hidden[100:] = True  # from the knees down
    person = syn.to_person(depth, hidden=hidden)
    lowest = posed.vertices[:, 1].max()
    start = BodyPose(syn.FACING @ syn.arms_down(), posed.nodes[0] - [0.0, raised, 0.0], 1.0)
    patient = fitter.tuning.sigmas + 10 * (0.02,)

    def lowest_of(floor):
        person_there = replace(person, floor=floor)
        pose = fit_pose(fitter, person_there.target(800), start, patient)
        return body.pose(pose.rotations, pose.root, pose.scale).vertices[:, 1].max()

    up = np.array([0.0, -1.0, 0.0])
    for height in (lowest - 0.02, lowest + 0.02):
        gaps = [abs(lowest_of(floor) - height) for floor in (np.zeros(4), np.array([*up, height]))]
        assert gaps[1] < 0.7 * gaps[0]
    far = np.array([*up, lowest + 0.5])
    assert lowest_of(far) == pytest.approx(lowest_of(np.zeros(4)), abs=2e-3)


def test_soles_are_the_lowest_of_balls_and_heels(body, fitter):
    feet = fitter.articulation.feet
    at = body.vertices[feet.soles]
    assert at[:, 1].max() < 0.03
    for side, sign in (("left", 1.0), ("right", -1.0)):
        own = sign * at[:, 0] > 0.0
        ankle, ball = (body.nodes[NODE_INDEX[f"{side}_{name}"], 2] for name in ("ankle", "foot"))
        for is_heel in (False, True):
            part = own & (feet.is_heel == is_heel)
            assert feet.share[part].sum() == pytest.approx(1.0)
            assert ((at[part, 2] < 0.5 * (ankle + ball)) == is_heel).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_ankle_is_a_hinge(fitter, axis):
    """Turned about the shank or the foot it is pulled back; about its hinge it hardly is."""
    rotations = syn.FACING @ syn.varied(0, 30.0)
    knee, ankle = NODE_INDEX["left_knee"], NODE_INDEX["left_ankle"]
    angle = 0.4
    turn = rotvec_to_matrix(angle * np.eye(3)[axis])
    rotations[ankle] = rotations[knee] @ turn
    other = NODE_INDEX["right_ankle"]
    rotations[other] = rotations[NODE_INDEX["right_knee"]]
    size = len(fitter.articulation.above)
    matrix, gradient = np.zeros((size, size)), np.zeros(size)
    tree.hold_neutral(fitter.articulation, 1.0, rotations, matrix, gradient)
    first = 3 + 3 * fitter.articulation.free[ankle]
    own = slice(first, first + 3)
    stiffness = fitter.articulation.neutral[fitter.articulation.free[ankle]]
    pull = rotations[knee].T @ gradient[own]  # in the shank's axes
    np.testing.assert_allclose(pull, -stiffness * np.sin(angle) * np.eye(3)[axis], atol=1e-12)
    np.testing.assert_allclose(
        rotations[knee].T @ matrix[own, own] @ rotations[knee], np.diag(stiffness), atol=1e-12
    )
    assert stiffness[0] < 0.2 * stiffness[1:].min()
    gradient[own] = 0.0
    assert np.abs(gradient).max() < 1e-12  # every other joint is free, or at rest


def disturbed_start(seed, degrees):
    """A posed body, and a start with all limbs off and the root 5 cm away."""
    true = syn.varied(seed, 25.0)
    turn = syn.FACING @ syn.rotation("y", 15.0 * seed)
    posed = syn.posed(true, turn=15.0 * seed)
    start = BodyPose(turn @ disturbed(true, seed + 10, degrees), posed.nodes[0] + [0.03, -0.02, 0.03], 1.0)
    return posed, start


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(("seed", "degrees"), [(1, 10.0), (1, 15.0), (3, 15.0), (4, 15.0)])
def test_a_known_pose_is_found_from_a_start_nearby(body, fitter, seed, degrees, noise):
    """All limbs off by 10 to 15 degrees each, so that hands and feet are 10 to 30 cm off."""
    posed, start = disturbed_start(seed, degrees)
    before = syn.joint_error(nodes_of(body, start), posed.nodes)
    assert before > 0.06
    target = target_of(posed, noise)
    quick = nodes_of(body, fit_pose(fitter, target, start))
    assert syn.joint_error(quick, posed.nodes) < 0.2 * before
    patient = nodes_of(body, fit_pose(fitter, target, start, fitter.tuning.sigmas + 10 * (0.02,)))
    assert syn.joint_error(patient, posed.nodes) < 0.010


def test_most_poses_are_found_from_any_start_nearby(body, fitter):
    """Seen from all sides, with limbs before and behind each other; a few starts are too far off."""
    errors = []
    for seed in range(12):
        posed, start = disturbed_start(seed, 10.0)
        errors.append(syn.joint_error(nodes_of(body, fit_pose(fitter, target_of(posed), start)), posed.nodes))
    assert np.median(errors) < 0.018
    assert np.mean(np.array(errors) < 0.03) > 0.7


def test_the_true_pose_stays(body, fitter):
    posed = syn.posed(syn.varied(5, 20.0))
    pose = BodyPose(syn.FACING @ syn.varied(5, 20.0), posed.nodes[0], 1.0)
    found = fit_pose(fitter, target_of(posed), pose)
    assert syn.joint_error(nodes_of(body, found), posed.nodes) < 0.008


def test_one_arm_far_off(body, fitter):
    true = syn.upright(left_shoulder=syn.rotation("z", 20.0))
    posed = syn.posed(true)
    start = BodyPose(syn.FACING @ syn.upright(left_shoulder=syn.rotation("z", -10.0)), posed.nodes[0], 1.0)
    found = nodes_of(body, fit_pose(fitter, target_of(posed), start))
    wrist = NODE_INDEX["left_wrist"]
    assert np.linalg.norm(nodes_of(body, start)[wrist] - posed.nodes[wrist]) > 0.25
    assert np.linalg.norm(found[wrist] - posed.nodes[wrist]) < 0.02


@pytest.mark.parametrize("scale", [0.7, 1.15])
def test_scale_is_kept(body, fitter, scale):
    posed = syn.posed(syn.arms_down(), scale=scale, distance=3.2)
    start = BodyPose(syn.FACING @ disturbed(syn.arms_down(), 0, 8.0), posed.nodes[0], scale)
    found = fit_pose(fitter, target_of(posed), start)
    assert found.scale == scale
    assert syn.joint_error(nodes_of(body, found), posed.nodes) < 0.02


def test_results_are_rotations_and_inputs_are_untouched(fitter):
    posed = syn.posed(syn.varied(1, 25.0))
    start = BodyPose(syn.FACING @ disturbed(syn.varied(1, 25.0), 1, 12.0), posed.nodes[0].copy(), 1.0)
    before = start.rotations.copy(), start.root.copy()
    found = fit_pose(fitter, target_of(posed), start)
    r = found.rotations
    np.testing.assert_allclose(r @ r.transpose(0, 2, 1), np.broadcast_to(np.eye(3), r.shape), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(r), 1.0)
    np.testing.assert_array_equal(start.rotations, before[0])
    np.testing.assert_array_equal(start.root, before[1])
    again = fit_pose(fitter, target_of(posed), start)
    np.testing.assert_array_equal(again.rotations, r)


@pytest.mark.parametrize(("free_space", "most"), [(0.0, 1e-6), (FitTuning().free_space_weight, 0.02)])
def test_half_a_turn_of_the_camera_turns_the_result(body, free_space, most):
    """Rolled by 180 degrees every pixel falls on a pixel, so the two fits see the very same.

    But of several person pixels that are equally near, the free-space term takes the first.
    """
    fitter = ArticulatedFitter(body, FitTuning(free_space_weight=free_space))
    true = syn.varied(2, 25.0)
    posed = syn.posed(true, height=0.95)
    depth = syn.draw(syn.mesh(posed))
    start = BodyPose(syn.FACING @ disturbed(true, 3, 12.0), posed.nodes[0] + [0.02, 0.0, 0.03], 1.0)
    roll = np.diag([-1.0, -1.0, 1.0])

    def fitted(image, pose, order):
        person = syn.to_person(image)
        target = person.target(len(person.points))
        return fit_pose(fitter, target._replace(points=person.points[::order], coarse=person.full), pose)

    plain = fitted(depth, start, 1)
    rolled = fitted(depth[::-1, ::-1], BodyPose(roll @ start.rotations, roll @ start.root, 1.0), -1)
    gap = nodes_of(body, rolled) - nodes_of(body, plain) @ roll
    assert np.linalg.norm(gap, axis=1).max() < most


@pytest.mark.parametrize(("distance", "aside", "turn"), [(3.5, 0.3, 0.0), (2.8, -0.3, 30.0)])
def test_moving_the_person_moves_the_result(body, fitter, distance, aside, turn):
    true = syn.varied(3, 20.0)
    placed = [{"turn": 0.0}, {"distance": distance, "aside": aside, "turn": turn}]
    found = []
    for where in placed:
        posed = syn.posed(true, **where)
        rotation = syn.FACING @ syn.rotation("y", where["turn"])
        start = BodyPose(rotation @ disturbed(true, 4, 8.0), posed.nodes[0], 1.0)
        nodes = nodes_of(body, fit_pose(fitter, target_of(posed), start))
        found.append((nodes - posed.nodes) @ rotation)  # error in the person's own frame
    assert np.linalg.norm(found[0] - found[1], axis=1).mean() < 0.015


def test_no_points_near_the_body_leave_it_where_it_is(body, fitter):
    """Far beyond reach nothing pulls, and nothing may become NaN."""
    target = target_of(syn.posed(syn.arms_down(), aside=0.3))
    start = BodyPose(syn.FACING @ syn.arms_down(), np.array([30.0, 0.0, 3.0]), 1.0)
    found = fit_pose(fitter, target, start)
    assert np.isfinite(found.rotations).all()
    np.testing.assert_allclose(found.root, start.root, atol=0.5)


def test_a_fit_tells_how_it_ended(fitter):
    """Its cost falls, its steps get short, and its information is symmetric and definite."""
    posed, start = disturbed_start(1, 10.0)
    target = target_of(posed)
    short, long = (fitter.fit(target, start, n * (0.02,)) for n in (2, 30))
    assert long.cost.points < short.cost.points
    assert long.last_turn < 0.2 * short.last_turn
    assert (long.iterations, long.points) == (30, len(target.points))
    np.testing.assert_allclose(long.information, long.information.T, rtol=1e-9, atol=1e-6)
    assert np.linalg.eigvalsh(long.information).min() > 0.0


def test_information_is_less_where_nothing_is_seen(body, fitter):
    """Legs below the image's border may stand anywhere; arms, which are in view, may not."""
    posed = syn.posed(syn.arms_down(), distance=2.8)
    depth = syn.draw(syn.mesh(posed))
    depth[depth.shape[0] // 2 :] = 0.0
    start = BodyPose(syn.FACING @ syn.arms_down(), posed.nodes[0], 1.0)
    result = fitter.fit(syn.to_person(depth).target(800, with_proposals=False), start)
    variance = np.diag(np.linalg.inv(result.information))
    turn = {
        n: variance[3 + 3 * fitter.articulation.free[NODE_INDEX[n]]] for n in ("left_shoulder", "left_knee")
    }
    assert turn["left_knee"] > 4.0 * turn["left_shoulder"]


def test_candidate_pose(bank):
    pose = bank.pose(Candidate(5, 0, syn.FACING, np.array([0.0, 0.1, 3.0]), 0.0, 0.0), 0.9)
    np.testing.assert_allclose(pose.rotations, syn.FACING @ bank.rotations(5), atol=1e-12)
    assert (pose.root.tolist(), pose.scale) == ([0.0, 0.1, 3.0], 0.9)


# --- E-step


def test_assignment_twin():
    """Responsibilities by the formula, every point with every visible vertex within reach."""
    rng = np.random.default_rng(0)
    vertices = rng.uniform([-0.3, -0.4, 2.0], [0.3, 0.4, 2.2], (150, 3))
    points = rng.uniform([-0.45, -0.55, 2.0], [0.45, 0.55, 2.2], (160, 3))
    visible = rng.random(150) < 0.7
    sigma, outlier = 0.04, 0.3
    mass, pull = np.empty(150), np.empty((150, 3))
    for stride in (1, 3):
        kernels.assign(points, stride, vertices, visible, sigma, outlier, mass, pull)
        used = points[::stride]
        gap = used[:, None] - vertices
        square = np.square(gap).sum(axis=-1)
        weight = np.exp(-0.5 * square / sigma**2) * visible * (square < (kernels._REACH * sigma) ** 2)
        p = weight / (outlier + weight.sum(axis=1, keepdims=True))
        np.testing.assert_allclose(mass, p.sum(axis=0), rtol=2e-3, atol=1e-5)
        np.testing.assert_allclose(pull, (p[..., None] * gap).sum(axis=0), rtol=2e-3, atol=1e-5)
        assert (mass > 0).sum() > 50
        assert mass.sum() <= len(used)


def test_assignment_without_visible_vertices():
    mass, pull = np.ones(5), np.ones((5, 3))
    vertices = np.ones((5, 3))
    kernels.assign(np.ones((4, 3)), 1, vertices, np.zeros(5, bool), 0.04, 0.3, mass, pull)
    assert not mass.any()
    assert not pull.any()


# --- M-step


def segment_of(fitter):
    """Node that moves each vertex most, (V,)."""
    return fitter.articulation.skin.influence[:, 0]


def _assembled(fitter, nodes, surface, mass, pull, plane_weight, point_weight):
    """Normal equations (P, P) and gradient (P,) of the data term alone."""
    size = len(fitter.articulation.above)
    equations = tree.Equations(np.zeros((len(nodes), 6, 6)), np.zeros((len(nodes), 6)))
    settings = fitter.settings._replace(plane_weight=plane_weight, point_weight=point_weight)
    origin = np.array([0.2, -0.1, 2.5])  # anything will do
    kernels.add_points(surface, mass, pull, origin, settings, equations)
    matrix, gradient = np.zeros((size, size)), np.zeros(size)
    tree.assemble(equations, fitter.articulation, nodes, origin, matrix, gradient)
    return matrix, gradient


def _jacobian(fitter, vertices, nodes, i):
    """Analytic Jacobian (3, P) of one vertex: the gradient for a unit residual along each axis."""
    one = slice(i, i + 1)
    surface = kernels.Surface(vertices[one], np.zeros((1, 3)), segment_of(fitter)[one])
    rows, squares = [], []
    for axis in np.eye(3):
        matrix, gradient = _assembled(fitter, nodes, surface, np.ones(1), axis[None], 0.0, 1.0)
        rows.append(gradient)
        squares.append(matrix)
    jacobian = np.array(rows)
    np.testing.assert_allclose(squares[0], jacobian.T @ jacobian, atol=1e-9)
    return jacobian


@pytest.mark.parametrize("rotations", [syn.upright(), syn.varied(0, 40.0)], ids=["rest", "posed"])
def test_jacobian_against_finite_differences(body, fitter, rotations):
    """Exact for vertices that one node moves; others count with the segment that moves them most."""
    rotations, root = syn.FACING @ rotations, np.array([0.1, 0.0, 3.0])
    posed = body.pose(rotations, root)
    size = len(fitter.articulation.above)
    step = 1e-5
    moved = np.empty((size, *posed.vertices.shape))
    for p in range(size):
        delta = np.zeros(size)
        delta[p] = step
        turned = rotations.copy()
        tree.update(delta, fitter.articulation, turned)
        moved[p] = (body.pose(turned, root + delta[:3]).vertices - posed.vertices) / step
    rigid = np.flatnonzero(body.weights.max(axis=1) > 0.995)
    for i in rigid[::11]:
        analytic = _jacobian(fitter, posed.vertices, posed.nodes, i)
        # what moves the other half percent of a vertex counts up to 1 cm per radian on a long lever
        np.testing.assert_allclose(analytic, moved[:, i].T, atol=0.01)


def test_data_term_twin(body, fitter):
    """The metric: all of the plane weight along the normal, the point weight in every direction."""
    rng = np.random.default_rng(0)
    posed = body.pose(syn.FACING @ syn.varied(1, 30.0), np.array([0.0, 0.0, 3.0]))
    some = rng.choice(len(posed.vertices), 20, replace=False)
    size = len(fitter.articulation.above)
    normals = rng.standard_normal((20, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mass, gap = rng.uniform(0.1, 2.0, 20), 0.02 * rng.standard_normal((20, 3))
    mass[3] = 1e-4  # too little to count
    surface = kernels.Surface(posed.vertices[some], normals, segment_of(fitter)[some])
    matrix, gradient = _assembled(fitter, posed.nodes, surface, mass, mass[:, None] * gap, 1.0, 0.3)
    expected, slope = np.zeros((size, size)), np.zeros(size)
    for k, i in enumerate(some):
        if k == 3:
            continue
        jacobian = _jacobian(fitter, posed.vertices, posed.nodes, i)
        metric = mass[k] * (np.outer(normals[k], normals[k]) + 0.3 * np.eye(3))
        expected += jacobian.T @ metric @ jacobian
        slope += jacobian.T @ metric @ gap[k]
    np.testing.assert_allclose(matrix, expected, atol=1e-9)
    np.testing.assert_allclose(gradient, slope, atol=1e-9)


def test_tree_solver_twin(body, fitter):
    """The equations of a whole body, against a dense solver."""
    posed = body.pose(syn.FACING @ syn.varied(2, 30.0), np.array([0.0, 0.0, 3.0]))
    rng = np.random.default_rng(0)
    count = len(posed.vertices)
    surface = kernels.Surface(posed.vertices, np.zeros((count, 3)), segment_of(fitter))
    mass, pull = rng.uniform(0.1, 1.0, count), rng.standard_normal((count, 3))
    matrix, gradient = _assembled(fitter, posed.nodes, surface, mass, pull, 0.0, 1.0)
    matrix += 0.1 * np.eye(len(matrix))
    expected = np.linalg.solve(matrix, gradient)
    tree.solve_tree(matrix, fitter.articulation.above, gradient)
    np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-9)


def test_free_space_pulls_into_the_silhouette_and_behind_the_surface(fitter):
    """One vertex at a time: beside the person, before the surface, behind it, where nothing is known."""
    labels = np.full((60, 80), BACKGROUND, np.uint8)
    labels[20:40, 30:50] = PERSON
    labels[:, 70:] = UNKNOWN
    depth = np.where(labels == PERSON, np.float32(2.0), np.float32(0.0))
    nearest = np.empty((60, 80, 2), np.int32)
    nearest_kernels.nearest_person(labels, nearest)
    c = syn.CAMERA._replace(cx=39.5, cy=29.5)
    settings = fitter.settings._replace(free_space_slack=0.04, free_space_limit=0.10)

    def pull(row, col, z):
        vertex = np.array([[(col - 39.5) / c.fx * z, (row - 29.5) / c.fy * z, z]])
        equations = tree.Equations(np.zeros((1, 6, 6)), np.zeros((1, 6)))
        surface = kernels.Surface(vertex, np.zeros((1, 3)), np.zeros(1, np.int32))
        observed = Observation(depth, labels, c)
        kernels.add_free_space(surface, observed, nearest, np.zeros(3), 1.0, settings, equations)
        return equations.force[0, 3:]

    x, y, z = pull(30, 25, 2.0)  # 5 pixels to the left: pulled to the right
    assert x == pytest.approx(5 / c.fx * 2.0)
    assert (abs(y) < 1e-12, z) == (True, 0.0)
    assert np.linalg.norm(pull(5, 5, 2.0)) == pytest.approx(0.10)  # at most the limit
    np.testing.assert_allclose(pull(30, 40, 1.9), [0, 0, 0.06], atol=1e-6)  # 10 cm before, 4 of them slack
    assert not pull(30, 40, 1.97).any()
    assert not pull(30, 40, 2.5).any()
    assert not pull(30, 75, 2.0).any()
    assert not pull(30, 200, 2.0).any()


def test_nearest_person_pixels_twin():
    """Two sweeps may miss the very nearest by a little, never by more than a pixel or so."""
    rng = np.random.default_rng(0)
    labels = (rng.random((40, 50)) < 0.02).astype(np.uint8)
    nearest = np.empty((40, 50, 2), np.int32)
    nearest_kernels.nearest_person(labels, nearest)
    people = np.argwhere(labels == PERSON)
    for i, j in np.ndindex(40, 50):
        assert labels[tuple(nearest[i, j])] == PERSON
        exact = np.sqrt(((people - [i, j]) ** 2).sum(axis=1).min())
        assert np.hypot(*(nearest[i, j] - [i, j])) <= exact + 1.0


def test_update_turns_whole_subtrees(fitter):
    """A node's segment turns by the product of its free ancestors' steps, the root's first."""
    rng = np.random.default_rng(0)
    size = len(fitter.articulation.above)
    step = 0.3 * rng.standard_normal(size)
    rotations = syn.varied(0, 30.0)
    updated = rotations.copy()
    tree.update(step, fitter.articulation, updated)
    for n in range(21):
        chain, turn = [], np.eye(3)
        k = n
        while k >= 0:
            chain.append(k)
            k = NODE_PARENTS[k]
        for k in reversed(chain):
            if fitter.articulation.free[k] >= 0:
                first = 3 + 3 * fitter.articulation.free[k]
                turn = turn @ rotvec_to_matrix(step[first : first + 3])
        np.testing.assert_allclose(updated[n], turn @ rotations[n], atol=1e-12)
    below = fitter.articulation.free >= 0
    assert below.sum() == len(fitter.articulation.stiffness)
    assert not below[NODE_INDEX["left_foot"]]  # follows the ankle


@pytest.mark.parametrize("size", [0.0, 1e-10, 1e-3, 1.0, 3.1])
def test_rodrigues_twin(size):
    out = np.empty((3, 3))
    for axis in np.random.default_rng(0).standard_normal((5, 3)):
        w = size * axis / np.linalg.norm(axis)
        rotation_of(w, out)
        np.testing.assert_allclose(out, rotvec_to_matrix(w), atol=1e-12)


# --- what is prepared once


def test_turned_normals_and_visibility(body, fitter):
    """A vertex is visible if it faces the camera and nothing lies before it."""
    posed = syn.posed(syn.arms_down())
    rotations = syn.FACING @ syn.arms_down()
    normals = np.empty_like(body.vertices)
    rest, influence = fitter.articulation.normals, body.skin.influence
    visibility.turn_normals(rest, influence, rotations, normals)
    main = rotations[influence[:, 0]]
    np.testing.assert_allclose(normals, np.einsum("vij,vj->vi", main, rest), atol=1e-9)
    drawn = syn.draw(syn.mesh(posed))
    visible = np.empty(len(normals), bool)
    visibility.mark_visible(posed.vertices, normals, drawn, syn.CAMERA, 0.05, visible)
    facing = (normals * posed.vertices).sum(axis=1) <= 0
    assert not visible[~facing].any()
    assert visible[facing].mean() > 0.8  # little of somebody with arms down is hidden
    wall = np.full_like(drawn, 2.0)
    visibility.mark_visible(posed.vertices, normals, wall, syn.CAMERA, 0.05, visible)
    assert not visible.any()


def test_sigmas_go_from_coarse_to_fine():
    sigmas = FitTuning().sigmas
    assert list(sigmas) == sorted(sigmas, reverse=True)
    assert sigmas[0] <= 0.1


@pytest.mark.parametrize("count", [4, 7, 8, 11])
def test_stages_share_one_schedule(count):
    tuning = FitTuning(sigmas=tuple(0.01 * (20 - k) for k in range(count)))
    assert tuning.glance + tuning.rough + tuning.fine == tuning.sigmas
    assert all((tuning.glance, tuning.rough, tuning.fine))
    assert tuning.trial == tuning.sigmas[: len(tuning.trial)]
