"""Personal builds: derivatives against differences, sums against plain ones, evidence into estimates."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.body.build import BUILD_NAMES, SPREAD, BuildSpace, prior_information
from depth_pose.body.build_file import KnownBuild
from depth_pose.body.pose import BodyPose
from depth_pose.core.rotations import rotvec_to_matrix
from depth_pose.refine import _build_kernels as kernels
from depth_pose.refine import personal as personal_builds
from depth_pose.refine.articulated import ArticulatedFitter
from depth_pose.refine.personal import BuildEvidence, Evidence
from depth_pose.refine.tuning import BuildTuning, FitTuning
from learned import Learned

PARTS = len(BUILD_NAMES)


@pytest.fixture(scope="module")
def space(body):
    return BuildSpace(body)


def pose_at(seed=0, turn=None, scale=1.02):
    turn = syn.rotation("y", 15.0) if turn is None else turn
    return BodyPose(syn.FACING @ turn @ syn.varied(seed, 30.0), np.array([0.1, 0.0, 3.0]), scale)


def target_of(depth):
    person = syn.to_person(depth)
    return person.target(800)


def test_rows_are_derivatives(space):
    """Of sampled vertices along random directions, by size, build, a turn and a shift of their segment."""
    rng, pose = np.random.default_rng(1), pose_at()
    build = rng.normal(0.0, 0.05, PARTS).astype(np.float32)
    body = space.body(build)
    shapes = kernels.Shapes(
        np.ascontiguousarray(space.vertices.transpose(1, 2, 0)),
        np.ascontiguousarray(space.nodes.transpose(1, 2, 0)),
    )
    own = kernels.Pose(pose.rotations, pose.root, pose.scale)
    shifts = kernels._node_shifts(body.skin.parents, shapes, own)
    model = kernels.Model(body.skin, shapes, own, shifts)
    vertices = body.pose(*vars(pose).values()).vertices
    step = 1e-3

    def moved(k, by):
        other = np.array(build)
        other[k] += np.float32(by)
        return space.body(other).pose(*vars(pose).values()).vertices, float(other[k])

    plus, high = zip(*(moved(k, step) for k in range(PARTS)), strict=True)
    minus, low = zip(*(moved(k, -step) for k in range(PARTS)), strict=True)
    by_part = (np.array(plus) - np.array(minus)) / (np.array(high) - np.array(low))[:, None, None]
    by_size = (
        body.pose(pose.rotations, pose.root, pose.scale * np.exp(step)).vertices
        - body.pose(pose.rotations, pose.root, pose.scale * np.exp(-step)).vertices
    ) / (2.0 * step)
    for i in range(0, len(vertices), 37):
        normal = rng.standard_normal(3)
        normal /= np.linalg.norm(normal)
        row = np.empty(8 + PARTS)
        kernels._fill_row(i, vertices, normal, 0.25, model, row)
        arm = vertices[i] - pose.root
        np.testing.assert_allclose(row[:3], [normal @ np.cross(axis, arm) for axis in np.eye(3)], atol=1e-12)
        np.testing.assert_allclose(row[3:6], normal, atol=1e-12)
        assert row[6] == pytest.approx(by_size[i] @ normal, abs=1e-5)
        np.testing.assert_allclose(row[7:-1], by_part[:, i] @ normal, atol=1e-5)
        assert row[-1] == 0.25


def followed(space, person, seed, frames=36):
    """What is learned of a person before a noisy camera, in random poses that change every fourth frame."""
    tuning, rng = BuildTuning(), np.random.default_rng(seed)
    fitter, finder = ArticulatedFitter(space.template), BuildEvidence(space, tuning, FitTuning())
    personal = Learned(tuning, space)
    for k in range(frames):
        personal.take_size(1.02, is_given=False)
        turn = syn.rotation("y", 20.0 * np.sin(k / 6.0 + seed))
        pose = pose_at(100 * seed + k // 4, turn, 1.0)
        depth = syn.draw(syn.mesh(person.pose(*vars(pose).values())))
        noisy = np.where(depth > 0, depth + 0.005 * rng.standard_normal(depth.shape), 0.0)
        target, body = target_of(noisy), space.body(personal.build)
        start = BodyPose(pose.rotations, pose.root, personal.scale)
        fitted = fitter.of(body).fit(target, start).pose
        personal.add(k * 60_000_000, 0.2, finder.find(body, target, fitted, personal.build))
    personal.take_size(1.02, is_given=False)
    return personal


def lengths(personal):
    """Sizes of all bones relative to the template's, the foot's left out, which is not learned."""
    parts = [k for k, name in enumerate(BUILD_NAMES[:9]) if name != "foot"]
    return personal.scale * (1.0 + personal.build[parts]), parts


@pytest.fixture(scope="module")
def people(space):
    """Two random builds, each followed twice in other poses and with other noise."""
    root = np.linalg.cholesky(np.linalg.inv(prior_information()))
    found = []
    for k in range(2):
        true = np.clip(root @ np.random.default_rng(5 + k).standard_normal(PARTS), -0.15, 0.15)
        person = space.body(true.astype(np.float32))
        found.append((true, followed(space, person, 1 + k), followed(space, person, 50 + k)))
    return found


def test_bones_of_random_people_are_found(people):
    """2.2 s of motion. Where the collar bones end shows least: shoulders may be off by 6 %."""
    errors = []
    for true, *learned in people:
        for personal in learned:
            got, parts = lengths(personal)
            errors.append(np.abs(got / (1.0 + true[parts]) - 1.0))
    assert np.median(errors) < 0.015, errors
    assert np.quantile(errors, 0.9) < 0.04, errors
    assert np.max(errors) < 0.07, errors


def test_the_same_person_twice_has_the_same_bones(people):
    apart = [np.abs(lengths(a)[0] / lengths(b)[0] - 1.0) for _, a, b in people]
    assert np.median(apart) < 0.01, apart
    assert np.max(apart) < 0.03, apart


def test_the_same_frames_give_the_same_build_to_the_last_bit(space):
    person = space.body(np.full(PARTS, 0.03, np.float32))
    first, again = (followed(space, person, 3, 6) for _ in range(2))
    assert first.scale == again.scale
    assert first.build.tobytes() == again.build.tobytes()
    assert first.known().build.tobytes() == again.known().build.tobytes()


def test_a_rigid_motion_of_everything_changes_no_evidence(space):
    """Turning camera and person together about the optical axis, in the absence of image borders."""
    pose = pose_at(3)
    target = target_of(syn.draw(syn.mesh(space.template.pose(*vars(pose).values()))))
    empty = target.full._replace(labels=np.full_like(target.full.labels, 2))
    turn = rotvec_to_matrix(np.array([0.0, 0.0, np.pi / 2]))
    finder = BuildEvidence(space, BuildTuning(free_space=0.0), FitTuning())
    none = np.zeros(PARTS, np.float32)
    straight = finder.find(space.template, target._replace(full=empty), pose, none)
    camera = target.coarse.camera
    turned_camera = camera._replace(
        width=camera.height, height=camera.width, fx=camera.fy, fy=camera.fx,
        cx=camera.height - 1 - camera.cy, cy=camera.cx,
    )  # fmt: skip
    coarse = target.coarse._replace(
        depth=np.ascontiguousarray(np.rot90(target.coarse.depth, -1)),
        labels=np.ascontiguousarray(np.rot90(target.coarse.labels, -1)),
        camera=turned_camera,
    )
    turned = target._replace(points=target.points @ turn.T, coarse=coarse, full=empty)
    other = finder.find(
        space.template, turned, BodyPose(turn @ pose.rotations, turn @ pose.root, pose.scale), none
    )
    spread = np.concatenate([[0.03], SPREAD])
    difference = (other.information - straight.information) * np.outer(spread, spread)
    size = np.abs(straight.information * np.outer(spread, spread)).max()
    assert np.abs(difference).max() < 0.05 * size  # pixels on edges fall otherwise


def test_what_frames_say_too_little_of_a_part_is_added(space, monkeypatch):
    pose, build = pose_at(3, scale=1.0), np.zeros(PARTS, np.float32)
    target = target_of(syn.draw(syn.mesh(space.template.pose(*vars(pose).values()))))
    lack = personal_builds.BUILD_BIAS
    assert lack[0] == 0.0 and lack[1 + BUILD_NAMES.index("thigh")] > 0.0

    def evidence():
        return BuildEvidence(space, BuildTuning(), FitTuning()).find(space.template, target, pose, build)

    told = evidence()
    monkeypatch.setattr(personal_builds, "BUILD_BIAS", np.zeros(1 + PARTS))
    plain = evidence()
    np.testing.assert_array_equal(told.information, plain.information)
    np.testing.assert_allclose(told.vector - plain.vector, plain.information @ lack, atol=1e-9)


def test_of_someone_unknown_the_matchers_size_is_taken(space):
    personal = Learned(BuildTuning(), space)
    personal.take_size(0.93, is_given=False)
    assert personal.scale == pytest.approx(0.93, rel=1e-6)
    assert not personal.build.any()
    np.testing.assert_allclose(personal.known().spread, SPREAD, rtol=1e-6)


def made_evidence(truth, seed):
    rows = np.random.default_rng(seed).standard_normal((40, 1 + PARTS))
    information = rows.T @ rows
    return Evidence(information, information @ truth)


def test_evidence_adds_up_to_the_truth_and_is_forgotten(space):
    truth = np.concatenate([[np.log(1.1)], np.linspace(-0.1, 0.1, PARTS)])
    personal = Learned(BuildTuning(memory=5.0), space)
    personal.take_size(1.08, is_given=False)
    for frame in range(200):
        personal.add(frame * 100_000_000, 0.1, made_evidence(truth, frame))
        personal.take_size(1.08, is_given=False)
    assert personal.scale == pytest.approx(1.1, rel=0.01)
    np.testing.assert_allclose(personal.build, truth[1:], atol=0.01)
    sure = personal.known()
    assert (sure.spread < SPREAD).all()
    other = np.concatenate([[np.log(1.1)], np.zeros(PARTS)])
    for frame in range(200, 500):
        personal.add(frame * 100_000_000, 0.1, made_evidence(other, frame))
        personal.take_size(1.08, is_given=False)
    np.testing.assert_allclose(personal.build, 0.0, atol=0.01)


def test_frames_that_fit_badly_say_little(space):
    truth = np.concatenate([[np.log(1.1)], np.linspace(-0.1, 0.1, PARTS)])
    spreads = {}
    for score in (0.1, 0.4):
        personal = Learned(BuildTuning(), space)
        personal.take_size(1.1, is_given=False)
        for frame in range(4):
            personal.add(frame * 100_000_000, score, made_evidence(truth, frame))
        personal.take_size(1.1, is_given=False)
        spreads[score] = personal.known().spread
        assert personal.build.any() == (score < 0.2)  # four good frames are enough, bad ones not
    assert (spreads[0.1] < spreads[0.4]).all()


def test_a_given_size_is_kept(space):
    truth = np.concatenate([[np.log(1.2)], np.zeros(PARTS)])
    personal = Learned(BuildTuning(), space)
    for frame in range(20):
        personal.take_size(1.0, is_given=True)
        personal.add(frame * 100_000_000, 0.1, made_evidence(truth, frame))
    personal.take_size(1.0, is_given=True)
    assert personal.scale == pytest.approx(1.0, abs=0.005)


def test_a_known_build_is_begun_with(space):
    build = np.linspace(-0.08, 0.08, PARTS)
    personal = Learned(BuildTuning(), space, KnownBuild(0.9, 0.005, build, np.full(PARTS, 0.01), 100))
    personal.take_size(0.95, is_given=False)
    np.testing.assert_allclose(personal.build, build, atol=1e-6)
    assert 0.9 < personal.scale < 0.91
