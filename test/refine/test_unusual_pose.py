"""Poses unlike any of the bank's: proposals speak for them, and then the pose prior is silent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import synthetic as syn
from acted import rotations, the_bank, the_body
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.pose_match import Candidate, PoseMatch
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_NODES, JOINTS
from depth_pose.refine.pose_prior import PosePrior, usual_joints
from stages import make_refiner

PLACE = np.array([0.0, 0.0, 3.0])


@pytest.mark.parametrize("lift", [1.6, 2.2])
def test_an_arm_that_no_exemplar_lifts_so_far_is_found(lift) -> None:
    posed = the_body().pose(R_CAMERA_FACING_MODEL @ rotations(lift, 0.1), PLACE)
    prior = PosePrior(usual_joints(the_bank()))
    assert prior.distance(posed.nodes, 1.0) > 1.2  # the 95th percentile of the bank is .98
    people = syn.to_people(syn.draw((posed.vertices, the_body().faces)))
    (person,) = people.persons
    joints = posed.nodes[JOINT_NODES]
    measured = JointMeasurement(
        places=joints.astype(np.float32),
        sigma=np.full((len(JOINTS), 2), 0.03, np.float32),
        confidence=np.full(len(JOINTS), 0.9, np.float32),
    )
    found = replace(person.found, measured=measured)
    people = replace(people, persons=(replace(person, found=found),))
    start = Candidate(0, 0, R_CAMERA_FACING_MODEL, PLACE, 0.0, 0.0)
    match = PoseMatch(person.body_id, the_bank().bank_id, 1.0, (start,))
    (fitted,) = make_refiner(the_bank()).refine(people, [match])
    assert np.linalg.norm(fitted.joints - joints, axis=1).max() < 0.06
