"""Messages of skeletons: those of the fits, with scores, and those of all people."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np
from depth_pose_msgs.msg import FittedArray, SkeletonArray
from depth_pose_msgs.msg import Joint as JointMsg
from depth_pose_msgs.msg import Skeleton as SkeletonMsg
from geometry_msgs.msg import Point
from numpy.typing import NDArray

from depth_pose.body.build import BuildSpace
from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.core.errors import InputError
from depth_pose.core.rotations import matrix_to_quat, quat_to_matrix
from depth_pose.core.skeleton import (
    JOINT_INDEX,
    JOINT_NODES,
    JOINTS,
    NODE_INDEX,
    NODES,
    JointState,
    Source,
    Tracking,
)
from depth_pose.core.types import BUILD_SIZE, Skeleton, six_numbers, symmetric
from depth_pose.ros.messages.basics import make_header, make_quaternion, stamp_to_ns
from depth_pose.ros.messages.checks import FARTHEST_M, check_numbers, check_people, check_shares
from depth_pose.track.person_view import FramePeople

_STATES = frozenset(map(int, JointState))

_TELLS_MOTION = hasattr(SkeletonMsg, "joint_velocities")
"""Whether the messages are of this version: in another workspace they may have been built before."""

_CLAVICLES = [NODE_INDEX["left_clavicle"], NODE_INDEX["right_clavicle"]]
"""Segments that a skeleton does not include."""


def skeleton_to_msg(skeleton: Skeleton) -> SkeletonMsg:
    """Build the message of a skeleton; without joints if it is lost."""
    rows = zip(
        JOINTS,
        skeleton.positions.tolist(),
        skeleton.quats_xyzw.tolist(),
        skeleton.joint_confidence.tolist(),
        skeleton.joint_states.tolist(),
        strict=False,
    )
    msg = SkeletonMsg(
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
    if _TELLS_MOTION:
        _add_motion(msg, skeleton)
    return msg


def _add_motion(msg: SkeletonMsg, skeleton: Skeleton) -> None:
    """Set the fields of the person as a whole, and the joints' velocities and covariances."""
    low, high = skeleton.box
    msg.tracking = int(skeleton.tracking)
    msg.centre, msg.box_min, msg.box_max = _point(skeleton.centre), _point(low), _point(high)
    msg.velocity.x, msg.velocity.y, msg.velocity.z = skeleton.velocity.tolist()
    msg.joint_velocities = _floats(skeleton.velocities)
    msg.joint_covariances = _floats(six_numbers(skeleton.covariances))


def _point(place: NDArray[np.float64]) -> Point:
    x, y, z = place.tolist()
    return Point(x=x, y=y, z=z)


def _floats(values: NDArray[np.float64]) -> array[float]:
    """Return numbers as a message takes them at once: a list is checked one by one."""
    return array("f", values.astype(np.float32).tobytes())


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
    values = getattr(msg, name, ())
    if len(values) not in (0, width * count):
        raise InputError(f"{name} of {msg.body_id} has {len(values)} numbers; it is none, or {width * count}")
    rows = check_numbers(f"{name} of {msg.body_id}", values).reshape(-1, width)
    return rows if [joint.name for joint in msg.joints] == list(JOINTS) else rows[:0]


def _tracking_of(msg: SkeletonMsg) -> Tracking:
    number = getattr(msg, "tracking", Tracking.UNKNOWN)
    if number not in tuple(Tracking):
        raise InputError(f"tracking of {msg.body_id} is {number}; it is one of 0 to {max(Tracking)}")
    return Tracking(number)


def skeletons_to_msg(skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> SkeletonArray:
    """Build the message of all skeletons in a frame."""
    return SkeletonArray(
        header=make_header(stamp_ns, frame_id), skeletons=[skeleton_to_msg(s) for s in skeletons]
    )


def fitted_to_msg(fitted: Sequence[Fitted], people: FramePeople) -> FittedArray:
    """Build the message of the bodies fitted to a frame's people.

    Each is sent as a skeleton without confidences and states, which the recovery node computes.
    """
    return FittedArray(
        header=make_header(people.stamp_ns, people.frame_id),
        skeletons=[_fitted_to_skeleton(f, people) for f in fitted],
        scores=[float(f.score) for f in fitted],
        clavicles=[
            make_quaternion(q)
            for f in fitted
            if not f.is_lost
            for q in matrix_to_quat(f.pose.rotations[_CLAVICLES]).tolist()
        ],
    )


def _fitted_to_skeleton(fitted: Fitted, people: FramePeople) -> SkeletonMsg:
    msg = SkeletonMsg(
        header=make_header(people.stamp_ns, people.frame_id),
        body_id=fitted.body_id,
        source=int(fitted.source),
        residual=float(fitted.gap),
    )
    if fitted.is_lost:
        return msg
    quats = matrix_to_quat(fitted.pose.rotations[JOINT_NODES]).tolist()
    msg.scale = float(fitted.pose.scale)
    msg.build = fitted.build.tolist()
    msg.joints = [
        JointMsg(name=name, position=Point(x=p[0], y=p[1], z=p[2]), orientation=make_quaternion(q))
        for name, p, q in zip(JOINTS, fitted.joints.tolist(), quats, strict=True)
    ]
    return msg


def msg_to_fitted(msg: FittedArray, space: BuildSpace) -> tuple[Fitted, ...]:
    """Convert a message to its fitted bodies, posed again.

    Parameters
    ----------
    msg : FittedArray
    space : BuildSpace
        Builds of the body that was fitted.

    Raises
    ------
    InputError
        If the numbers of scores and skeletons differ, or a skeleton is invalid.
    """
    if len(msg.scores) != len(msg.skeletons):
        raise InputError(f"there are {len(msg.scores)} scores of {len(msg.skeletons)} skeletons")
    check_people("skeletons", [s.body_id for s in msg.skeletons])
    skeletons = [msg_to_skeleton(s) for s in msg.skeletons]
    posed = sum(len(s.positions) > 0 for s in skeletons)
    if len(msg.clavicles) != 2 * posed:
        raise InputError(f"there are {len(msg.clavicles)} clavicles of {posed} skeletons, not 2 of each")
    quats = check_numbers("the turn of a clavicle", [(q.x, q.y, q.z, q.w) for q in msg.clavicles])
    clavicles = iter(quats.reshape(-1, 2, 4))
    return tuple(
        _skeleton_to_fitted(s, score, next(clavicles), space)
        if len(s.positions)
        else Fitted.lost(s.stamp_ns, s.body_id)
        for s, score in zip(skeletons, msg.scores, strict=True)
    )


def _skeleton_to_fitted(
    skeleton: Skeleton, score: float, clavicles: NDArray[np.float64], space: BuildSpace
) -> Fitted:
    """Pose the body of a skeleton, keeping its joints."""
    rotations = np.empty((len(NODES), 3, 3))
    rotations[JOINT_NODES] = quat_to_matrix(skeleton.quats_xyzw)
    rotations[_CLAVICLES] = quat_to_matrix(clavicles)
    pose = BodyPose(rotations, skeleton.positions[JOINT_INDEX["pelvis"]], skeleton.scale)
    mesh = space.body(skeleton.build).pose(pose.rotations, pose.root, pose.scale)
    nodes = mesh.nodes.copy()
    nodes[JOINT_NODES] = skeleton.positions
    return Fitted(
        skeleton.body_id,
        skeleton.stamp_ns,
        skeleton.source,
        FittedBody(pose, mesh.vertices, nodes),
        skeleton.build,
        score,
        skeleton.residual,
    )


def _source_of(number: int) -> Source:
    if number not in tuple(Source):
        raise InputError(f"the skeleton's source is {number}; it is one of 0 to {max(Source)}")
    return Source(number)
