"""How sure a skeleton is, and how each joint was seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.labels import PERSON, UNKNOWN
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.skeleton import JOINT_INDEX, JOINT_NODES, JOINTS, JointState
from depth_pose.recover.confidence import (
    KINDS,
    SIGNS,
    fit_confidence,
    measure_joint_signs,
    report_joints,
)

SCORE = 0.22
"""Rendered-depth score of a usual good fit."""


def test_confidence_falls_with_the_score():
    scores = np.linspace(0.0, 1.0, 21)
    values = [fit_confidence(s) for s in scores]
    assert values[0] > 0.99
    assert values[-1] < 0.01
    assert (np.diff(values) < 0).all()


def _report(rotations, **placed):
    body = syn.posed(rotations, **placed)
    person = syn.to_person(syn.draw(syn.mesh(body)))
    return report_joints(body.nodes[JOINT_NODES], placed.get("scale", 1.0), person, SCORE)


@pytest.mark.parametrize("scale", [0.7, 1.0])
def test_a_person_seen_from_the_front_is_all_seen(scale):
    report = _report(syn.arms_down(), distance=2.8, scale=scale)
    assert (report.states == JointState.SEEN).all()
    assert report.confidence.min() > 0.8
    assert np.mean(report.confidence) > 0.93


def test_the_far_arm_of_a_profile_is_hidden():
    report = _report(syn.arms_down(), turn=90.0)
    hidden = {JOINTS[j] for j in np.flatnonzero(report.states == JointState.OCCLUDED)}
    near, far = ("left", "right") if "right_elbow" in hidden else ("right", "left")
    assert f"{far}_elbow" in hidden
    assert f"{far}_shoulder" in hidden
    assert not {f"{near}_shoulder", f"{near}_elbow", f"{near}_wrist", "head"} & hidden
    certain = report.confidence[[JOINT_INDEX[f"{near}_elbow"], JOINT_INDEX[f"{far}_elbow"]]]
    assert certain[0] > certain[1]


def test_joints_beyond_the_border_are_outside():
    report = _report(syn.arms_down(), distance=1.6)
    outside = {JOINTS[j] for j in np.flatnonzero(report.states == JointState.OUTSIDE_IMAGE)}
    assert {"left_ankle", "right_ankle", "left_foot", "right_foot"} <= outside
    assert "chest" not in outside
    confidence = dict(zip(JOINTS, report.confidence, strict=True))
    assert max(confidence["left_foot"], confidence["right_foot"]) < 0.7
    assert max(confidence["left_foot"], confidence["right_foot"]) < min(
        confidence[n] for n in JOINTS if n not in outside
    )


def test_joints_behind_something_are_hidden():
    """A post before the left arm: its pixels say unknown."""
    body = syn.posed(syn.arms_down())
    joints = body.nodes[JOINT_NODES]
    elbow = joints[JOINT_INDEX["left_elbow"]]
    post, col = np.zeros((144, 176), bool), round(syn.CAMERA.project(elbow)[0])
    post[:, col - 3 : col + 4] = True
    person = syn.to_person(syn.draw(syn.mesh(body)), hidden=post)
    report = report_joints(joints, 1.0, person, SCORE)
    assert report.states[JOINT_INDEX["left_elbow"]] == JointState.OCCLUDED
    assert report.states[JOINT_INDEX["right_elbow"]] == JointState.SEEN


def test_a_joint_in_free_space_is_less_certain():
    body = syn.posed(syn.arms_down())
    person = syn.to_person(syn.draw(syn.mesh(body)))
    joints = body.nodes[JOINT_NODES].copy()
    j = JOINT_INDEX["left_wrist"]
    good = report_joints(joints, 1.0, person, SCORE).confidence[j]
    joints[j, 0] += 0.25
    assert report_joints(joints, 1.0, person, SCORE).confidence[j] < 0.6 < 0.9 < good


def test_a_poor_fit_makes_every_joint_less_certain():
    body = syn.posed(syn.arms_down())
    person = syn.to_person(syn.draw(syn.mesh(body)))
    good, poor = (report_joints(body.nodes[JOINT_NODES], 1.0, person, s).confidence for s in (0.15, 0.5))
    assert (poor < good).all()


def test_a_joint_where_the_finder_proposes_it_is_more_certain():
    """And one that is proposed elsewhere, surely, is less; the farther, the less, up to 40 cm."""
    body = syn.posed(syn.arms_down())
    person = syn.to_person(syn.draw(syn.mesh(body)))
    joints, j = body.nodes[JOINT_NODES], JOINT_INDEX["left_wrist"]

    def confidence(away, sure):
        places = (joints + np.array([away, 0.0, 0.0])).astype(np.float32)
        sigma, confidences = (
            np.full((len(JOINTS), 2), 0.05, np.float32),
            np.full(len(JOINTS), sure, np.float32),
        )
        found = replace(person.found, measured=JointMeasurement(places, sigma, confidences))
        return report_joints(joints, 1.0, replace(person, found=found), SCORE).confidence[j]

    assert confidence(0.0, 0.9) > confidence(0.2, 0.9) > confidence(0.4, 0.9)
    assert confidence(0.4, 0.9) == pytest.approx(confidence(0.8, 0.9))
    assert confidence(0.0, 0.9) > confidence(0.0, 0.5) > confidence(0.0, 0.0)
    without = report_joints(joints, 1.0, person, SCORE).confidence[j]
    assert confidence(0.0, 0.9) > without > confidence(0.0, 0.0)


def test_what_hides_a_joint_matters():
    """An arm behind the trunk hides behind oneself; behind a post it does not."""
    oneself = list(SIGNS).index("hidden behind oneself")
    body = syn.posed(syn.arms_down(), turn=90.0)
    found = measure_joint_signs(body.nodes[JOINT_NODES], 1.0, syn.to_person(syn.draw(syn.mesh(body))))
    hidden = found.states == JointState.OCCLUDED
    assert hidden.any()
    np.testing.assert_array_equal(found.signs[:, oneself], hidden)
    body = syn.posed(syn.arms_down())
    joints, post = body.nodes[JOINT_NODES], np.zeros((144, 176), bool)
    elbow = JOINT_INDEX["left_elbow"]
    column = round(syn.CAMERA.project(joints[elbow])[0])
    post[:, column - 3 : column + 4] = True
    found = measure_joint_signs(joints, 1.0, syn.to_person(syn.draw(syn.mesh(body)), hidden=post))
    assert found.states[elbow] == JointState.OCCLUDED
    assert found.signs[elbow, oneself] == 0.0


def test_a_foot_below_an_ankle_that_is_seen_is_told_from_one_below_nothing():
    """It is the more certain of the two, where all else is alike."""
    sign = list(SIGNS).index("outside, the other end seen")
    body = syn.posed(syn.arms_down(), distance=1.9)
    joints, person = body.nodes[JOINT_NODES].copy(), syn.to_person(syn.draw(syn.mesh(body)))
    foot, ankle, knee = (JOINT_INDEX[f"left_{n}"] for n in ("foot", "ankle", "knee"))
    assert measure_joint_signs(joints, 1.0, person).states[ankle] == JointState.OUTSIDE_IMAGE
    assert measure_joint_signs(joints, 1.0, person).signs[foot, sign] == 0.0
    joints[ankle] = joints[knee] + 0.5 * (joints[ankle] - joints[knee])  # in the image
    found = measure_joint_signs(joints, 1.0, person)
    assert (found.states[ankle], found.states[foot]) == (JointState.SEEN, JointState.OUTSIDE_IMAGE)
    assert found.signs[foot, sign] == 1.0
    assert SIGNS["outside, the other end seen"] > 0.0


def test_what_lies_outside_the_image_is_no_free_space():
    """Of a shank whose lower half the image does not show, the shown half alone is looked at."""
    body = syn.posed(syn.arms_down(), distance=1.9)
    person = syn.to_person(syn.draw(syn.mesh(body)))
    found = measure_joint_signs(body.nodes[JOINT_NODES], 1.0, person)
    free = list(SIGNS).index("segment in free space")
    for name in ("left_ankle", "right_ankle", "left_foot", "right_foot"):
        assert found.states[JOINT_INDEX[name]] == JointState.OUTSIDE_IMAGE
        assert found.signs[JOINT_INDEX[name], free] == 0.0


def test_signs_and_confidence_follow_the_formulas():
    """The kernel against plain numpy: labels and gaps at the joint, and at six places of the segment."""
    body = syn.posed(syn.arms_down(), turn=60.0)
    person = syn.to_person(syn.draw(syn.mesh(body)))
    joints = body.nodes[JOINT_NODES] + np.random.default_rng(2).normal(size=(19, 3)) * 0.06
    found, camera = measure_joint_signs(joints, 1.0, person), person.full.camera
    below = {"wrist": 0.03, "foot": 0.03, "ankle": 0.04, "elbow": 0.05, "knee": 0.06}
    toward = {"wrist": "elbow", "elbow": "shoulder", "knee": "hip", "ankle": "knee", "foot": "ankle"}

    def look(at, depth_below):
        row = round(camera.fy * at[1] / at[2] + camera.cy)
        column = round(camera.fx * at[0] / at[2] + camera.cx)
        if not (0 <= row < person.full.depth.shape[0] and 0 <= column < person.full.depth.shape[1]):
            return 0, 0.0
        label = person.full.labels[row, column]
        return label, at[2] - depth_below - float(person.full.depth[row, column]) if label == PERSON else 0.0

    for name, kind in ((n, n.split("_")[-1]) for n in JOINTS if n.split("_")[-1] in toward):
        j, end = JOINT_INDEX[name], JOINT_INDEX[name.replace(kind, toward[kind])]
        here, there = below[kind], below.get(toward[kind], 0.11)
        looked = [
            look(joints[j] + t * (joints[end] - joints[j]), here + t * (there - here))
            for t in np.arange(6) / 6
        ]
        free = [label == 0 for label, _ in looked]
        hidden = [label == UNKNOWN or (label == PERSON and gap > 0.07) for label, gap in looked]
        gaps = [
            min(abs(g) / 0.07, 2.0) for (_, g), f, h in zip(looked, free, hidden, strict=True) if not (f or h)
        ]
        np.testing.assert_allclose(
            found.signs[j, 5:8], [np.mean(free), np.mean(hidden), sum(gaps) / 6], atol=1e-6, err_msg=name
        )
        gap = looked[0][1]
        alone = [hidden[0], 0.0, free[0], 0.0, 0.0]
        if not (free[0] or hidden[0]):
            alone[3:] = [np.clip(-gap / 0.07, 0, 2), max(gap / 0.07, 0)]
        np.testing.assert_allclose(found.signs[j, :5], np.array(alone, float), atol=1e-6, err_msg=name)
        assert found.signs[j, 8] == (looked[0][0] == PERSON and hidden[0]), name
    report = report_joints(joints, 1.0, person, SCORE)
    j = JOINT_INDEX["left_wrist"]
    zero = report_joints(joints, 1.0, person, 0.0).confidence[j]
    odds = KINDS["wrist"] + found.signs[j] @ np.array(list(SIGNS.values()))
    np.testing.assert_allclose(np.log(zero / (1 - zero)), odds, atol=1e-9)
    assert report.confidence[j] < zero
