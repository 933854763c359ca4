"""The skeleton of an answer: joints fused with the measured ones, their visibility, and confidences."""

from __future__ import annotations

import numpy as np

from depth_pose.body.pose import Fitted
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import JOINT_NODES, Source
from depth_pose.recover.confidence import report_joints, skeleton_confidence
from depth_pose.recover.measurements import covariances, weigh_joints
from depth_pose.track.person_view import PersonView

TRUST = {Source.REFINED: 1.0, Source.RECOVERED: 0.8}
"""Factor on the confidence of a skeleton by its source."""

_JOINT_TRUST = {Source.REFINED: 1.0, Source.RECOVERED: 0.9}
"""Factor on the confidence of its joints."""


def to_skeleton(person: PersonView, answer: Fitted) -> Skeleton:
    """Build the skeleton of an answer, not filtered.

    Parameters
    ----------
    person : PersonView
    answer : Fitted
        A body that was fitted to the same frame.

    Returns
    -------
    Skeleton
        In the camera frame. Its joints are those of the body, fused with the measured ones.
    """
    scale, score, source = answer.pose.scale, answer.score, answer.source
    sure = report_joints(answer.joints, scale, person, score, is_compared=False).confidence
    fused = weigh_joints(answer.joints, score, sure, person.measured, answer.mean_depth_error)
    joints = fused.joints
    seen = report_joints(joints, scale, person, score)
    joint_confidence = _JOINT_TRUST[source] * seen.confidence
    return Skeleton(
        stamp_ns=person.stamp_ns,
        frame_id=person.frame_id,
        body_id=person.body_id,
        source=source,
        confidence=TRUST[source] * skeleton_confidence(person, joints, seen.states, joint_confidence),
        residual=answer.mean_depth_error,
        scale=scale,
        positions=joints,
        quats_xyzw=matrix_to_quat(answer.pose.rotations[JOINT_NODES]),
        joint_confidence=joint_confidence.astype(np.float32),
        joint_states=seen.states,
        build=answer.build,
        covariances=covariances(joints, fused.variance, seen.states),
    )
