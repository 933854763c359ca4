"""Skeletons: the refiner's, with their scores, and everybody's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from depth_pose_msgs.msg import FittedArray, SkeletonArray
from depth_pose_msgs.msg import Joint as JointMsg
from depth_pose_msgs.msg import Skeleton as SkeletonMsg
from geometry_msgs.msg import Point

from depth_pose.core.errors import InputError
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointState, Source
from depth_pose.core.types import BUILD_SIZE, Fitted, Skeleton
from depth_pose.ros.messages.basics import make_header, make_quaternion, stamp_to_ns
from depth_pose.ros.messages.checks import check_numbers, check_people
from depth_pose.track.person import People

_STATES = frozenset(map(int, JointState))


def skeleton_to_msg(skeleton: Skeleton) -> SkeletonMsg:
    """Message of a skeleton; without joints where it is lost."""
    rows = zip(
        JOINTS,
        skeleton.positions.tolist(),
        skeleton.quats_xyzw.tolist(),
        skeleton.joint_confidence.tolist(),
        skeleton.joint_states.tolist(),
        strict=False,
    )
    return SkeletonMsg(
        header=make_header(skeleton.stamp_ns, skeleton.frame_id),
        body_id=skeleton.body_id,
        source=int(skeleton.source),
        confidence=float(skeleton.confidence),
        residual=float(skeleton.residual),
        scale=float(skeleton.scale),
        joints=[
            JointMsg(
                name=name,
                position=Point(x=p[0], y=p[1], z=p[2]),
                orientation=make_quaternion(q),
                confidence=confidence,
                state=state,
            )
            for name, p, q, confidence, state in rows
        ],
        build=skeleton.build.tolist(),
    )


def msg_to_skeleton(msg: SkeletonMsg) -> Skeleton:
    """Skeleton of a message, equal to the one that was sent.

    Raises
    ------
    InputError
        If there are joints, but not the 19 of `depth_pose.core.skeleton.JOINTS`, or a number is none that a
        skeleton can have.
    """
    count = len(msg.joints)
    names = [joint.name for joint in msg.joints]
    if count and sorted(names) != sorted(JOINTS):
        odd = sorted(set(names) ^ set(JOINTS))
        raise InputError(
            f"the skeleton has {count} joints; missing or unknown: {', '.join(odd) or 'doubles'}"
        )
    joints = sorted(msg.joints, key=lambda joint: JOINT_INDEX[joint.name])
    odd_state = [joint.state for joint in joints if joint.state not in _STATES]
    if odd_state:
        raise InputError(
            f"a joint of {msg.body_id} has the state {odd_state[0]}; it is one of 0 to {max(_STATES)}"
        )
    if len(msg.build) not in (0, BUILD_SIZE):
        raise InputError(
            f"the build of {msg.body_id} has {len(msg.build)} numbers; it is none, or {BUILD_SIZE}"
        )
    return Skeleton(
        stamp_ns=stamp_to_ns(msg.header.stamp),
        frame_id=msg.header.frame_id,
        body_id=msg.body_id,
        source=_source_of(msg.source),
        confidence=msg.confidence,
        residual=msg.residual,
        scale=float(check_numbers(f"the scale of {msg.body_id}", msg.scale, 100.0)),
        positions=check_numbers(
            f"a joint of {msg.body_id}", [(j.position.x, j.position.y, j.position.z) for j in joints]
        ).reshape(count, 3),
        quats_xyzw=check_numbers(
            f"the turn of a joint of {msg.body_id}",
            [(j.orientation.x, j.orientation.y, j.orientation.z, j.orientation.w) for j in joints],
        ).reshape(count, 4),
        joint_confidence=np.array([j.confidence for j in joints], np.float32),
        joint_states=np.array([j.state for j in joints], np.uint8),
        build=check_numbers(f"the build of {msg.body_id}", msg.build, 100.0).astype(np.float32),
    )


def skeletons_to_msg(skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> SkeletonArray:
    """Message of everybody in a frame."""
    return SkeletonArray(
        header=make_header(stamp_ns, frame_id), skeletons=[skeleton_to_msg(s) for s in skeletons]
    )


def fitted_to_msg(fitted: Sequence[Fitted], people: People) -> FittedArray:
    """Message of the bodies fitted to a frame's people."""
    return FittedArray(
        header=make_header(people.stamp_ns, people.frame_id),
        skeletons=[skeleton_to_msg(f.skeleton) for f in fitted],
        scores=[float(f.score) for f in fitted],
    )


def msg_to_fitted(msg: FittedArray) -> tuple[Fitted, ...]:
    """Give the fitted bodies of a message, equal to those that were sent.

    Raises
    ------
    InputError
        If there are not as many scores as skeletons, or a skeleton is damaged.
    """
    if len(msg.scores) != len(msg.skeletons):
        raise InputError(f"there are {len(msg.scores)} scores of {len(msg.skeletons)} skeletons")
    check_people("skeletons", [s.body_id for s in msg.skeletons])
    return tuple(
        Fitted(msg_to_skeleton(s), score) for s, score in zip(msg.skeletons, msg.scores, strict=True)
    )


def _source_of(number: int) -> Source:
    if number not in tuple(Source):
        raise InputError(f"the skeleton's source is {number}; it is one of 0 to {max(Source)}")
    return Source(number)
