"""Messages of skeletons."""

from __future__ import annotations

import numpy as np
from depth_pose_msgs.msg import Skeleton as SkeletonMsg
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.joint import symmetric
from depth_pose.core.result import BUILD_SIZE, Skeleton
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS, JointState, Source, Tracking
from depth_pose.ros.messages.basics import stamp_to_ns
from depth_pose.ros.messages.checks import FARTHEST_M, check_numbers, check_shares

_STATES = frozenset(map(int, JointState))


def msg_to_skeleton(msg: SkeletonMsg) -> Skeleton:
    """Convert a message to its skeleton, equal to the one that was sent.

    Raises
    ------
    InputError
        If there are joints, but not the 19 of `depth_pose.core.skeleton.JOINTS`, or a number is not valid in
        a skeleton.
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
        confidence=float(check_shares(msg.body_id or "a skeleton", msg.confidence)),
        residual=float(check_numbers(f"the residual of {msg.body_id}", msg.residual, FARTHEST_M)),
        scale=float(check_numbers(f"the scale of {msg.body_id}", msg.scale, 100.0)),
        positions=check_numbers(
            f"a joint of {msg.body_id}", [(j.position.x, j.position.y, j.position.z) for j in joints]
        ).reshape(count, 3),
        quats_xyzw=check_numbers(
            f"the turn of a joint of {msg.body_id}",
            [(j.orientation.x, j.orientation.y, j.orientation.z, j.orientation.w) for j in joints],
        ).reshape(count, 4),
        joint_confidence=check_shares(f"a joint of {msg.body_id}", [j.confidence for j in joints]),
        joint_states=np.array([j.state for j in joints], np.uint8),
        build=check_numbers(f"the build of {msg.body_id}", msg.build, 100.0).astype(np.float32),
        velocities=_rows(msg, "joint_velocities", 3, count),
        covariances=symmetric(_rows(msg, "joint_covariances", 6, count)),
        tracking=_tracking_of(msg),
    )


def _rows(msg: SkeletonMsg, name: str, width: int, count: int) -> NDArray[np.float64]:
    """Return numbers of all joints, one row each; no rows where they are unknown.

    Joints in another order than ours have none: the numbers are in the order of the joints.
    """
    values = getattr(msg, name)
    if len(values) not in (0, width * count):
        raise InputError(f"{name} of {msg.body_id} has {len(values)} numbers; it is none, or {width * count}")
    rows = check_numbers(f"{name} of {msg.body_id}", values).reshape(-1, width)
    return rows if [joint.name for joint in msg.joints] == list(JOINTS) else rows[:0]


def _tracking_of(msg: SkeletonMsg) -> Tracking:
    if msg.tracking not in tuple(Tracking):
        raise InputError(f"tracking of {msg.body_id} is {msg.tracking}; it is one of 0 to {max(Tracking)}")
    return Tracking(msg.tracking)


def _source_of(number: int) -> Source:
    if number not in tuple(Source):
        raise InputError(f"the skeleton's source is {number}; it is one of 0 to {max(Source)}")
    return Source(number)
