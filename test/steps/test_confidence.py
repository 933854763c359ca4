"""How sure a skeleton is, and how each joint was seen."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic as syn
from depth_pose.skeleton import JOINT_INDEX, JOINT_NODES, JOINTS, JointState
from depth_pose.steps.confidence import report_joints, skeleton_confidence
from depth_pose.steps.view import view_person
from depth_pose.types import UNKNOWN, PersonCloud


def test_confidence_falls_with_the_score():
    scores = np.linspace(0.0, 1.0, 21)
    values = [skeleton_confidence(s) for s in scores]
    assert values[0] > 0.99
    assert values[-1] < 0.01
    assert (np.diff(values) < 0).all()


def _report(rotations, **placed):
    body = syn.posed(rotations, **placed)
    cloud = syn.to_cloud(syn.draw(syn.mesh(body)))
    return report_joints(body.nodes[JOINT_NODES], placed.get("scale", 1.0), view_person(cloud))


@pytest.mark.parametrize("scale", [0.7, 1.0])
def test_a_person_seen_from_the_front_is_all_seen(scale):
    report = _report(syn.arms_down(), distance=2.8, scale=scale)
    assert (report.states == JointState.SEEN).all()
    assert report.certainty.min() > 0.4
    assert np.mean(report.certainty) > 0.9


def test_the_far_arm_of_a_profile_is_hidden():
    report = _report(syn.arms_down(), turn=90.0)
    hidden = {JOINTS[j] for j in np.flatnonzero(report.states == JointState.OCCLUDED)}
    near, far = ("left", "right") if "right_elbow" in hidden else ("right", "left")
    assert f"{far}_elbow" in hidden
    assert f"{far}_shoulder" in hidden
    assert not {f"{near}_shoulder", f"{near}_elbow", f"{near}_wrist", "head"} & hidden
    certain = report.certainty[[JOINT_INDEX[f"{near}_elbow"], JOINT_INDEX[f"{far}_elbow"]]]
    assert certain[0] > certain[1]


def test_joints_beyond_the_border_are_outside():
    report = _report(syn.arms_down(), distance=1.6)
    outside = {JOINTS[j] for j in np.flatnonzero(report.states == JointState.OUTSIDE_IMAGE)}
    assert {"left_ankle", "right_ankle", "left_foot", "right_foot"} <= outside
    assert "chest" not in outside
    assert (report.certainty[[JOINT_INDEX[n] for n in outside]] < 0.5).all()


def test_joints_behind_something_are_hidden():
    """A post before the left arm: its pixels say unknown."""
    body = syn.posed(syn.arms_down())
    cloud = syn.to_cloud(syn.draw(syn.mesh(body)))
    joints = body.nodes[JOINT_NODES]
    elbow = joints[JOINT_INDEX["left_elbow"]]
    labels, points = cloud.labels.copy(), cloud.points.copy()
    col = round(syn.CAMERA.fx * elbow[0] / elbow[2] + syn.CAMERA.cx)
    labels[:, col - 3 : col + 4] = UNKNOWN
    points[:, col - 3 : col + 4] = np.nan
    view = view_person(PersonCloud(0, "", points, labels))
    report = report_joints(joints, 1.0, view)
    assert report.states[JOINT_INDEX["left_elbow"]] == JointState.OCCLUDED
    assert report.states[JOINT_INDEX["right_elbow"]] == JointState.SEEN


def test_a_joint_in_free_space_is_less_certain():
    body = syn.posed(syn.arms_down())
    view = view_person(syn.to_cloud(syn.draw(syn.mesh(body))))
    joints = body.nodes[JOINT_NODES].copy()
    j = JOINT_INDEX["left_wrist"]
    good = report_joints(joints, 1.0, view).certainty[j]
    joints[j, 0] += 0.25
    assert report_joints(joints, 1.0, view).certainty[j] < good
