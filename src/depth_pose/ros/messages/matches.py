"""Messages of the matcher's results."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from depth_pose_msgs.msg import Candidate as CandidateMsg
from depth_pose_msgs.msg import PoseMatch as PoseMatchMsg
from depth_pose_msgs.msg import PoseMatchArray
from geometry_msgs.msg import Transform, Vector3

from depth_pose.core.errors import InputError
from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix
from depth_pose.core.types import Candidate, PoseMatch
from depth_pose.ros.messages.basics import make_header, make_quaternion
from depth_pose.ros.messages.checks import check_numbers, check_people
from depth_pose.track.person_view import FramePeople


def matches_to_msg(matches: Sequence[PoseMatch], people: FramePeople) -> PoseMatchArray:
    """Build the message of the matches of a frame's people."""
    return PoseMatchArray(
        header=make_header(people.stamp_ns, people.frame_id),
        matches=[
            PoseMatchMsg(
                body_id=m.body_id,
                bank_id=m.bank_id,
                scale=float(m.scale),
                candidates=[_candidate_to_msg(c) for c in m.candidates],
            )
            for m in matches
        ],
    )


def _candidate_to_msg(candidate: Candidate) -> CandidateMsg:
    x, y, z = candidate.translation.tolist()
    quat = make_quaternion(matrix_to_quat(candidate.rotation).tolist())
    return CandidateMsg(
        exemplar=int(candidate.exemplar),
        view=int(candidate.view),
        transform=Transform(translation=Vector3(x=x, y=y, z=z), rotation=quat),
        distance=float(candidate.distance),
        score=float(candidate.score),
    )


def msg_to_matches(msg: PoseMatchArray) -> tuple[PoseMatch, ...]:
    """Return the matches of a message, equal to those that were sent.

    Raises
    ------
    InputError
        If a number is not valid in a match.
    """
    check_people("matches", [m.body_id for m in msg.matches])
    for m in msg.matches:
        if m.candidates and not 0.01 < m.scale < 100.0:
            raise InputError(f"the scale of {m.body_id} is {m.scale:g}")
    return tuple(
        PoseMatch(
            body_id=m.body_id,
            bank_id=m.bank_id,
            scale=m.scale,
            candidates=tuple(_msg_to_candidate(c) for c in m.candidates),
        )
        for m in msg.matches
    )


def _msg_to_candidate(msg: CandidateMsg) -> Candidate:
    t, q = msg.transform.translation, msg.transform.rotation
    turn = check_numbers("the turn of a match", [q.x, q.y, q.z, q.w], 2.0)
    if not 0.5 < float(turn @ turn) < 2.0:
        raise InputError(f"the turn of a match is no quaternion: its length is {np.linalg.norm(turn):g}")
    return Candidate(
        exemplar=msg.exemplar,
        view=msg.view,
        rotation=quat_to_matrix(turn / np.linalg.norm(turn)),
        translation=check_numbers("the place of a match", [t.x, t.y, t.z]),
        distance=msg.distance,
        score=msg.score,
    )
