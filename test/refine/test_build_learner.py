"""Everybody's build: begun with a file, learned from good frames, kept with an id, best of all known."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.body.build import BUILD_NAMES, BuildSpace
from depth_pose.body.build_file import KnownBuild, save_build
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.config import PersonalConfig
from depth_pose.core.errors import ConfigError
from depth_pose.core.measurement import Proposals
from depth_pose.core.skeleton import JOINT_NODES, MIRROR_JOINTS
from depth_pose.refine.build_learner import BuildLearner
from depth_pose.track.state import Shape

PARTS = len(BUILD_NAMES)


@pytest.fixture(scope="module")
def space(body):
    return BuildSpace(body)


@pytest.fixture(scope="module")
def seen(space):
    """A frame that shows somebody with long thighs, and the pose."""
    build = np.zeros(PARTS, np.float32)
    build[BUILD_NAMES.index("thigh")] = 0.1
    pose = BodyPose(syn.FACING @ syn.varied(2, 30.0), np.array([0.0, 0.0, 3.0]), 1.0)
    posed = space.body(build).pose(pose.rotations, pose.root, pose.scale)
    person = syn.to_person(syn.draw(syn.mesh(posed)))
    target = person.target(800)
    return target, FittedBody(pose, posed.vertices, posed.nodes)


def learner_of(space, **settings):
    return BuildLearner(space, PersonalConfig(**settings))


def follow(learner, seen, shape, first, frames, score=0.1):
    """Show frames of somebody, 100 ms apart."""
    for k in range(first, first + frames):
        stamp_ns = syn.START_NS + k * 100_000_000
        shape = learner.learn(learner.begin(shape, 1.0), *seen, score, stamp_ns)
    return shape


def test_a_good_frame_is_learned_from_and_a_bad_one_is_not(space, seen):
    assert follow(learner_of(space), seen, Shape(), 0, 5).frames == 5
    assert follow(learner_of(space), seen, Shape(), 0, 5, score=0.9).frames == 0
    assert follow(learner_of(space, personal=False), seen, Shape(), 0, 5).frames == 0


def test_of_somebody_known_every_frame_is_not_needed(space, seen):
    learner = learner_of(space)
    known = follow(learner, seen, Shape(), 0, 20)
    assert known.frames == 20
    assert follow(learner, seen, known, 20, 10).frames == 25


def test_a_build_goes_on_from_what_was_known(space, seen):
    learner = learner_of(space)
    before = follow(learner, seen, Shape(), 0, 5)
    kept = before.information.copy()
    after = follow(learner, seen, before, 5, 3)
    assert (before.frames, after.frames) == (5, 8)
    np.testing.assert_array_equal(before.information, kept)
    assert np.trace(after.information) > 1.3 * np.trace(kept)


def test_the_best_known_is_of_whom_most_was_seen(space, seen):
    learner = learner_of(space)
    assert learner.best_known() is None
    for first, frames in ((0, 3), (3, 8), (11, 2)):
        learner.keep(follow(learner, seen, Shape(), first, frames))
    assert learner.best_known().frames == 8
    learner.reset()
    assert learner.best_known() is None


def test_a_file_is_begun_with_and_a_bad_one_refused(space, tmp_path):
    build = np.linspace(-0.05, 0.05, PARTS)
    save_build(tmp_path / "me.json", KnownBuild(0.9, 0.01, build, np.full(PARTS, 0.01), 99))
    learner = learner_of(space, file=str(tmp_path / "me.json"))
    np.testing.assert_allclose(learner.begin(Shape(), 0.9).build, build, atol=1e-4)
    with pytest.raises(ConfigError, match=r"no\.json: the build cannot be read"):
        learner_of(space, file=str(tmp_path / "no.json"))


def test_proposed_bones_are_learned_in_bad_frames_as_well(space, seen):
    """Else a size that clothes made too large, or proposals too small, would never be set right again."""
    target, fitted = seen
    nodes = syn.posed(syn.arms_down(), body=space.template).nodes
    joints = nodes[JOINT_NODES] * 0.8  # as proposed: a fifth smaller
    places, weights = np.stack([joints, joints[MIRROR_JOINTS]]), np.full((2, len(joints)), 0.68)
    sigmas = np.full((2, len(joints), 2), 0.04)
    proposals = Proposals(np.asarray(JOINT_NODES, np.int64), places, weights, sigmas)
    proposing = target._replace(proposals=proposals)
    standing = FittedBody(fitted.pose, fitted.vertices, nodes)
    learner = learner_of(space)
    personal = follow(learner, (proposing, standing), Shape(), 0, 12, score=0.9)
    assert personal.frames == 0
    assert learner.best_known() is None
    assert personal.scale < 0.9
    assert follow(learner_of(space), seen, Shape(), 0, 12, score=0.9).scale == pytest.approx(1.0)
