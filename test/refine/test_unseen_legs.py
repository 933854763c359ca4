"""Legs beyond the image's border go halfway to where legs usually are; all else stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from depth_pose.body.pose import BodyPose, FittedBody
from depth_pose.core.skeleton import NODE_INDEX
from depth_pose.refine.pose_prior import usual_joints
from depth_pose.refine.unseen_legs import UnseenLegs

KNEE_BENT = {"left_knee": syn.rotation("x", 35.0)}
LEFT = [NODE_INDEX[f"left_{n}"] for n in ("ankle", "foot")]


@pytest.fixture(scope="module")
def legs(bank):
    return UnseenLegs(usual_joints(bank))


def _fitted(body, down_m, **turned):
    pose = BodyPose(syn.FACING @ syn.upright(**turned), np.array([0.0, down_m, 1.6]), 1.0)
    posed = body.pose(pose.rotations, pose.root)
    return FittedBody(pose, posed.vertices, posed.nodes)


def test_whole_people_stay_as_they_are(body, legs):
    fitted = _fitted(body, 0.12, **KNEE_BENT)
    small = syn.CAMERA._replace(fx=60.0, fy=60.0)
    assert legs.settle(body, fitted, small) is fitted


def test_a_shank_out_of_view_hangs_more_as_shanks_do(body, legs):
    """The knees are in view, what is below them is not, and one knee is bent as the other is not."""
    fitted = _fitted(body, 0.12, **KNEE_BENT)
    settled = legs.settle(body, fitted, syn.CAMERA)
    _, v = syn.CAMERA.project(fitted.nodes).T
    assert v[NODE_INDEX["left_knee"]] < syn.CAMERA.height < v[LEFT].min()
    moved = np.linalg.norm(settled.nodes - fitted.nodes, axis=1)
    beyond = v > syn.CAMERA.height
    np.testing.assert_allclose(moved[~beyond], 0.0, atol=1e-9)
    # halfway to straight: it has turned toward the way that a straight one points
    there = _fitted(body, 0.12).nodes
    straight = there[LEFT[0]] - there[NODE_INDEX["left_knee"]]
    before, after = (f.nodes[LEFT[0]] - f.nodes[NODE_INDEX["left_knee"]] for f in (fitted, settled))
    assert np.linalg.norm(before) == pytest.approx(np.linalg.norm(after), rel=1e-6)
    assert np.linalg.norm(after - straight) < 0.85 * np.linalg.norm(before - straight)
    # the mesh goes along
    posed = body.pose(settled.pose.rotations, settled.pose.root)
    np.testing.assert_allclose(settled.vertices, posed.vertices)


def test_a_hip_out_of_view_says_nothing(body, legs):
    fitted = _fitted(body, 1.2, **KNEE_BENT)
    assert legs.settle(body, fitted, syn.CAMERA) is fitted


def test_joints_that_were_fitted_apart_from_the_pose_stay(body, legs):
    """Coherent point drift finds joints by control vertices: those of the pose lie up to 4 cm from them."""
    fitted = _fitted(body, 0.12, **KNEE_BENT)
    shifted = replace(fitted, nodes=fitted.nodes + [0.03, -0.02, 0.01])
    settled = legs.settle(body, shifted, syn.CAMERA)
    np.testing.assert_allclose(
        settled.nodes, legs.settle(body, fitted, syn.CAMERA).nodes + [0.03, -0.02, 0.01], atol=0.004
    )
    beyond = [NODE_INDEX[f"{side}_{n}"] for side in ("left", "right") for n in ("ankle", "foot")]
    others = np.setdiff1d(np.arange(len(fitted.nodes)), beyond)
    np.testing.assert_array_equal(settled.nodes[others], shifted.nodes[others])


def test_few_exemplars_are_enough(body, bank):
    few = UnseenLegs(usual_joints(bank)[:5])
    assert np.isfinite(few.settle(body, _fitted(body, 0.12, **KNEE_BENT), syn.CAMERA).nodes).all()
