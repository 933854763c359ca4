"""Proposed depth of the trunk: one that proposals see far deeper than skin tells is taken to be deeper."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.body.build import BUILD_NAMES, BuildSpace, prior_information
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES
from depth_pose.refine.proposed_depth import DEPTHS, TrunkSkin, observe_depth
from depth_pose.refine.running_median import forget
from depth_pose.refine.upright_stance import SUREST, Standing

PARTS = len(BUILD_NAMES)
BREADTH, DEPTH = (BUILD_NAMES.index(girth) for girth in ("trunk_breadth", "trunk_depth"))


@pytest.fixture(scope="module")
def space(body):
    return BuildSpace(body)


@pytest.fixture(scope="module")
def skin(space):
    return TrunkSkin(space)


def fitted(space, turn=0.0, build=None):
    body = space.body(np.asarray(build, np.float32)) if build is not None else space.template
    rotations = syn.rotation("y", turn) @ syn.FACING @ syn.upright()
    root = np.array([0.0, 0.0, 3.0])
    posed = body.pose(rotations, root, 1.0)
    return FittedBody(BodyPose(rotations, root, 1.0), posed.vertices, posed.nodes)


def deeper(space, pose, by, sure=1.0):
    """Joints that are proposed so much deeper than the fitted ones, metres."""
    places = pose.nodes[JOINT_NODES] + by * np.array([0.0, 0.0, 1.0])
    return Standing(places, np.full(len(JOINT_INDEX), SUREST), sure)


def measured(space, skin, by, turn=0.0, build=None):
    pose = fitted(space, turn, build)
    own = np.zeros(PARTS, np.float32) if build is None else np.asarray(build, np.float32)
    return skin.measure(deeper(space, pose, by), pose, own)


class Told:
    """Proposed depths over frames."""

    def __init__(self, frames):
        self.depth, self.row = DEPTHS.empty(), np.zeros(1 + PARTS)
        for frame in frames:
            self.add(frame)

    def add(self, frame):
        self.depth = DEPTHS.add(self.depth, np.array([frame.depth]), np.array([frame.sure]))
        self.row = self.row + frame.sure * frame.row

    def forget(self, kept):
        self.depth, self.row = forget(self.depth, kept), kept * self.row

    def observe(self, information, vector):
        return observe_depth(self.depth, self.row, information, vector)


def known(value=0.0):
    """What adults are like, and a size that is known well."""
    information = np.zeros((1 + PARTS, 1 + PARTS))
    information[0, 0] = 0.03**-2
    information[1:, 1:] = prior_information()
    return information, information @ np.full(1 + PARTS, value)


def test_depths_are_measured_along_the_ray(space, skin):
    assert measured(space, skin, 0.0).depth == pytest.approx(0.0, abs=1e-6)
    assert measured(space, skin, 0.06).depth == pytest.approx(0.06, abs=0.002)
    assert measured(space, skin, 0.06).sure == pytest.approx(1.0)


def test_who_faces_the_camera_is_deep_by_depth_and_who_stands_aside_by_breadth(space, skin):
    front, aside = measured(space, skin, 0.0).row[1:], measured(space, skin, 0.0, turn=90.0).row[1:]
    assert front[DEPTH] > 5.0 * abs(front[BREADTH])
    assert aside[BREADTH] > 5.0 * abs(aside[DEPTH])
    for row in (front, aside):
        assert not np.delete(row, [BREADTH, DEPTH]).any()


def test_a_deep_build_lies_as_deep_as_its_girths_say(space, skin):
    build = np.zeros(PARTS)
    build[DEPTH] = 0.2
    there = measured(space, skin, 0.01, build=build)
    assert there.depth == pytest.approx(0.01 + 0.2 * there.row[1 + DEPTH], abs=0.003)


def test_a_coat_is_taken_for_a_deep_trunk_and_a_shirt_is_not(space, skin):
    usual = np.linalg.solve(*known())
    shirt = np.linalg.solve(*Told([measured(space, skin, 0.04)] * 5).observe(*known()))
    np.testing.assert_array_equal(shirt, usual)
    coats = [
        np.linalg.solve(*Told([measured(space, skin, by)] * 5).observe(*known())) for by in (0.06, 0.08, 0.1)
    ]
    row = measured(space, skin, 0.0).row
    lies = [float(row @ x) for x in coats]
    assert lies == sorted(lies)
    assert lies[0] > 0.03
    assert lies[2] == pytest.approx(0.1, abs=0.01)
    assert all(x[0] == pytest.approx(0.0, abs=1e-9) for x in coats)  # the size does not follow


def test_the_median_is_taken_and_two_frames_do_not_decide(space, skin):
    deep, plain = measured(space, skin, 0.1), measured(space, skin, 0.0)
    usual = np.linalg.solve(*known())
    for frames in ([deep] * 2, [deep] * 4 + [plain] * 6):
        np.testing.assert_array_equal(np.linalg.solve(*Told(frames).observe(*known())), usual)
    assert np.linalg.solve(*Told([deep] * 6 + [plain] * 4).observe(*known()))[1 + DEPTH] > 0.2


def test_what_was_proposed_is_forgotten(space, skin):
    depth = Told([measured(space, skin, 0.1)] * 10)
    for _ in range(40):
        depth.forget(0.9)
        depth.add(measured(space, skin, 0.0))
    np.testing.assert_array_equal(np.linalg.solve(*depth.observe(*known())), np.linalg.solve(*known()))
