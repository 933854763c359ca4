"""Decoders of the messages between the nodes: everybody on the same domain may send them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from decoders_messages import skeleton
from depth_pose_msgs.msg import Packed, SkeletonArray
from harness import Decoder
from rclpy.serialization import deserialize_message, serialize_message

from depth_pose.body.pose import BodyPose, Fitted, FittedBody
from depth_pose.body.procedural import make_body
from depth_pose.core.camera import Camera
from depth_pose.core.errors import DepthPoseError
from depth_pose.core.measurement import JointMeasurement
from depth_pose.core.pose_match import Candidate, PoseMatch
from depth_pose.core.result import BUILD_SIZE
from depth_pose.core.skeleton import NODES, Source
from depth_pose.io.skeleton_cdr import write_people
from depth_pose.ros.messages.fits import fitted_to_msg, msg_to_fitted
from depth_pose.ros.messages.matches import matches_to_msg, msg_to_matches
from depth_pose.ros.messages.people import msg_to_people, people_to_msg
from depth_pose.ros.messages.skeletons import msg_to_skeleton
from depth_pose.track.person_view import see_people
from depth_pose.track.tracked_person import TrackedPerson

CAMERA = Camera(32, 24, 30.0, 30.0, 15.5, 11.5)


def everybody() -> Any:
    """Two people side by side."""
    labels = np.zeros((24, 32), np.uint8)
    labels[4:20, 3:12], labels[4:20, 18:28] = 1, 2
    depth = np.where(labels > 0, np.float32(2.0), np.float32(0.0))
    rng = np.random.default_rng(0)
    found = [
        TrackedPerson(
            n,
            f"body_{n}",
            0.9,
            JointMeasurement(*(rng.random(shape).astype("f4") for shape in ((19, 3), (19, 2), 19))),
        )
        for n in (1, 2)
    ]
    return see_people(7, "optical", CAMERA, depth, labels, found)


PEOPLE = everybody()
BODY = make_body()


def matches() -> list[bytes]:
    """A match for each of them."""
    one = Candidate(3, 1, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 2.0]), 0.1, 0.5)
    of_all = [PoseMatch(f"body_{n}", "bank", 1.0, (one, one)) for n in (1, 2)]
    return [serialize_message(matches_to_msg(of_all, PEOPLE))]


def fitted() -> list[bytes]:
    """A fitted body for each of them."""
    body, build = BODY, np.full(BUILD_SIZE, 0.01, np.float32)
    pose = BodyPose(np.tile(np.diag([1.0, -1.0, -1.0]), (len(NODES), 1, 1)), np.array([0.0, 0.0, 2.0]), 0.9)
    posed = body.pose(pose.rotations, pose.root, pose.scale)
    fit = FittedBody(pose, posed.vertices, posed.nodes)
    of_all = [Fitted(f"body_{n}", 7, Source.REFINED, fit, build, 0.5, 0.01) for n in (1, 2)]
    return [serialize_message(fitted_to_msg(of_all, PEOPLE))]


def skeletons() -> list[bytes]:
    """Everybody's skeletons."""
    return [write_people([skeleton(), skeleton(1)], 7, "optical")]


def _reader(kind: type, convert: Callable[[Any], object]) -> Callable[[bytes], object]:
    """Read a message as nodes do: what is none of its type is counted where it is taken."""

    def read(data: bytes) -> object:
        try:
            message = deserialize_message(data, kind)
        except Exception as e:  # rclpy has no error of its own for it
            raise DepthPoseError(str(e)) from e
        answer = convert(message)
        _check_finite(answer)
        return answer

    return read


def _check_finite(answer: object) -> None:
    """Refuse places that are none; what a node works with is finite."""
    for one in answer if isinstance(answer, tuple) else ():
        for name in ("positions", "quats_xyzw", "nodes"):
            values = np.zeros(1) if getattr(one, "is_lost", False) else getattr(one, name, np.zeros(1))
            if not np.isfinite(values).all():
                raise ArithmeticError(f"{name} are not finite")


DECODERS = (
    Decoder(
        "node_people", lambda: [serialize_message(people_to_msg(PEOPLE))], _reader(Packed, msg_to_people)
    ),
    Decoder("node_matches", matches, _reader(Packed, lambda m: msg_to_matches(m)[1])),
    Decoder("node_fitted", fitted, _reader(Packed, lambda m: msg_to_fitted(m, len(BODY.vertices))[1])),
    Decoder(
        "node_skeletons",
        skeletons,
        _reader(SkeletonArray, lambda m: tuple(map(msg_to_skeleton, m.skeletons))),
    ),
)
