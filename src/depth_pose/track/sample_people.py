"""A sample person for warm-up: an exemplar of the bank, seen from the front."""

from __future__ import annotations

import numpy as np

from depth_pose.bank.bank import Bank
from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.core.labels import BACKGROUND, PERSON
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_NODES
from depth_pose.track.person_view import FramePeople, see_people
from depth_pose.track.tracked_person import TrackedPerson

_CAMERA = Camera(width=176, height=144, fx=200.0, fy=200.0, cx=87.5, cy=71.5)
"""Camera of the sample image, pixels."""
_SIGMA_M = 0.05
"""Standard deviation of the sample person's proposals (m)."""
SAMPLE_DISTANCE_M = 3.2
"""Distance from the camera to the sample person (m)."""


def sample_people(bank: Bank) -> FramePeople:
    """Render the bank's first pose into a frame, with its joints as proposals."""
    posed = bank.body.pose(R_CAMERA_FACING_MODEL @ bank.rotations(0), np.array([0.0, 0.0, SAMPLE_DISTANCE_M]))
    drawn = render_depth(posed.vertices, bank.body.faces, _CAMERA)
    depth = np.where(np.isfinite(drawn), drawn, 0.0).astype(np.float32)
    labels = np.where(depth > 0, PERSON, BACKGROUND).astype(np.uint8)
    joints = posed.nodes[JOINT_NODES].astype(np.float32)
    sure, sigma = np.ones(len(joints), np.float32), np.full((len(joints), 2), _SIGMA_M, np.float32)
    found = TrackedPerson(PERSON, "sample", 1.0, JointMeasurement(joints, sigma, sure))
    return see_people(0, "", _CAMERA, depth, labels, [found])
