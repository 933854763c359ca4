"""Outputs of REP-155: ``/humans/bodies/...`` and frames on ``/tf``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from depth_pose.body.body import Body
from depth_pose.body.build import BuildSpace
from depth_pose.body.human_model import JOINTS, LINKS, Posture, Sizes, make_urdf, posture_of
from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.core.skeleton import JointState as Seen
from depth_pose.ros.messages.basics import make_header
from depth_pose.ros.transport.tf import LATCHED, Transforms, stamped, stamped_all

if TYPE_CHECKING:
    from depth_pose.ros.nodes.node_base import StageNode

QUEUE = 10
"""Queue length for a slow subscriber."""

KEPT_NS = 3_000_000_000
"""Time for which a person's topics stay after the last sighting, nanoseconds: longer than an id is kept."""

TRACKED_NS = 1_000_000_000
"""Time for which a person stays in ``tracked`` after a frame without them, nanoseconds. A client drops a body
that is not listed and subscribes again when it returns. Busy nodes process people in turn, so each of three
people is answered in every third frame.
"""

KEY_POINTS: tuple[str, ...] = (
    *("head", "neck", "right_shoulder", "right_elbow", "right_wrist"),
    *("left_shoulder", "left_elbow", "left_wrist", "right_hip", "right_knee", "right_ankle"),
    *("left_hip", "left_knee", "left_ankle", "head", "head", "head", "head"),
)
"""Our joint for each key point of ``hri_msgs/Skeleton2D``. Nose, eyes and ears are not detected: they get the
head's position and zero confidence."""

_UNKNOWN = [0, 14, 15, 16, 17]
"""Key points that are not detected: nose, eyes and ears."""


class Rep155Outputs:
    """Publishes ``tracked``, and for each person ``skeleton2d``, ``joint_states``, ``urdf`` and frames.

    Parameters
    ----------
    node : StageNode
    body : Body
        The bank's, whose proportions a person's build changes.
    prefix : str
        Prefix of the ids.

    Raises
    ------
    ConfigError
        If the messages are not installed, or the prefix is not valid in names of topics.
    """

    def __init__(self, node: StageNode, body: Body, prefix: str) -> None:
        if not re.fullmatch(r"([A-Za-z_][A-Za-z0-9_]*)?", prefix):
            raise ConfigError(
                f"tf_prefix is {prefix!r}; with rep155 topics are named by it: "
                "give letters, digits and _, no digit first"
            )
        self._node, self._prefix, self._space = node, prefix, BuildSpace(body)
        self._ids, self._skeleton2d, self._point = _hri_messages()
        self._tracked = node.open_publisher(self._ids, "/humans/bodies/tracked", QUEUE)
        self._transforms = Transforms(node, "the parameter rep155")
        self._bodies: dict[str, _BodyTopics] = {}

    def publish(
        self,
        skeletons: Sequence[Skeleton],
        stamp_ns: int,
        frame_id: str,
        upright: Sequence[Skeleton] = (),
        camera: Camera | None = None,
    ) -> None:
        """Publish one frame.

        Parameters
        ----------
        skeletons, stamp_ns, frame_id
            All people, and the stamp and the name of their frame.
        upright : sequence of Skeleton
            The same people in the frame of the camera.
        camera : Camera, optional
            Whose image ``skeleton2d`` refers to; without one, it is not published.
        """
        self._close_old(stamp_ns)
        header, frames = make_header(stamp_ns, frame_id), []
        for skeleton, seen in zip_longest(skeletons, upright):
            if skeleton.is_lost:
                continue
            body_id = self._prefix + human_id(skeleton.body_id)
            topics = self._topics(body_id, skeleton)
            if self._transforms.is_heard or topics.states.get_subscription_count():
                posture = posture_of(skeleton, topics.sizes)
                frames += body_frames(body_id, skeleton, posture)
                names = [f"{name}_{body_id}" for name in JOINTS]
                topics.states.publish(JointState(header=header, name=names, position=posture.angles.tolist()))
            if camera is not None and topics.skeleton2d.get_subscription_count():
                points = key_points(seen, camera).tolist()
                topics.skeleton2d.publish(
                    self._skeleton2d(
                        header=make_header(seen.stamp_ns, seen.frame_id),
                        skeleton=[self._point(x=x, y=y, c=c) for x, y, c in points],
                    )
                )
        ids = [b for b, t in self._bodies.items() if stamp_ns - t.seen_ns <= TRACKED_NS]
        self._tracked.publish(self._ids(header=header, ids=ids))
        if frames:
            self._transforms.publish(frames)

    def _topics(self, body_id: str, skeleton: Skeleton) -> _BodyTopics:
        """Open a person's topics, and publish the build when it changes."""
        if body_id not in self._bodies:
            self._bodies[body_id] = _BodyTopics(self._node, body_id, self._skeleton2d)
        topics = self._bodies[body_id]
        topics.seen_ns = skeleton.stamp_ns
        build = (skeleton.build, skeleton.scale)
        if topics.build is None or build[1] != topics.build[1] or (build[0] != topics.build[0]).any():
            topics.build = build
            topics.set_sizes(Sizes.of(self._space.body(skeleton.build).nodes, skeleton.scale))
        return topics

    def _close_old(self, now_ns: int) -> None:
        for body_id in [b for b, t in self._bodies.items() if not 0 <= now_ns - t.seen_ns <= KEPT_NS]:
            self._bodies.pop(body_id).close()


class _BodyTopics:
    """The topics of one person, and the parameter ``human_description_ID``."""

    def __init__(self, node: StageNode, body_id: str, skeleton2d: type) -> None:
        self._node, self._id = node, body_id
        root = f"/humans/bodies/{body_id}"
        self.skeleton2d = node.open_publisher(skeleton2d, f"{root}/skeleton2d", QUEUE)
        self.states = node.open_publisher(JointState, f"{root}/joint_states", QUEUE)
        self._urdf = node.open_publisher(String, f"{root}/urdf", LATCHED)
        self.seen_ns = 0
        self.build: tuple[NDArray[np.float32], float] | None = None
        self._sizes: Sizes | None = None

    @property
    def sizes(self) -> Sizes:
        """Proportions of the published URDF."""
        assert self._sizes is not None
        return self._sizes

    def set_sizes(self, sizes: Sizes) -> None:
        """Publish a URDF, unless the last one is still accurate."""
        if self._sizes is not None and sizes.is_like(self._sizes):
            return
        self._sizes = sizes
        urdf, name = make_urdf(self._id, sizes), f"human_description_{self._id}"
        self._urdf.publish(String(data=urdf))
        if self._node.has_parameter(name):
            self._node.set_parameters([Parameter(name, Parameter.Type.STRING, urdf)])
        else:
            self._node.declare_parameter(name, urdf)

    def close(self) -> None:
        """Remove the topics and the parameter."""
        for publisher in (self.skeleton2d, self.states, self._urdf):
            self._node.close_publisher(publisher)
        self._node.undeclare_parameter(f"human_description_{self._id}")


def human_id(body_id: str) -> str:
    """Return the id of a person under REP-155, where frames and topics begin with ``body_``: ``b7``."""
    number = body_id.removeprefix("body_")
    return body_id if number == body_id else f"b{number}"


def body_frames(body_id: str, skeleton: Skeleton, posture: Posture) -> list[Any]:
    """Frames of a person's links: ``body_ID`` in the sensor's frame, the others in that one."""
    names = [f"{name}_{body_id}" for name in LINKS]
    T_body_link = np.linalg.inv(posture.frames[0]) @ posture.frames[1:]
    return [
        stamped(skeleton.stamp_ns, skeleton.frame_id, names[0], posture.frames[0]),
        *stamped_all(skeleton.stamp_ns, names[0], names[1:], T_body_link),
    ]


def key_points(skeleton: Skeleton, camera: Camera) -> NDArray[np.float64]:
    """Project the key points of ``hri_msgs/Skeleton2D`` into the image.

    Parameters
    ----------
    skeleton : Skeleton
        In the camera's frame.
    camera : Camera

    Returns
    -------
    (18, 3) float64
        Column and row as shares of width and height, 0 to 1, and confidence; 0 for what is outside the image.
    """
    joints = [JOINT_INDEX[name] for name in KEY_POINTS]
    shares = (camera.project(skeleton.positions[joints]) + 0.5) / (camera.width, camera.height)
    confidence = np.where(
        skeleton.joint_states[joints] == Seen.OUTSIDE_IMAGE, 0.0, skeleton.joint_confidence[joints]
    )
    confidence[_UNKNOWN] = 0.0
    return np.column_stack([np.clip(shares, 0.0, 1.0), confidence])


def _hri_messages() -> tuple[Any, Any, Any]:
    try:
        from hri_msgs.msg import IdsList, NormalizedPointOfInterest2D, Skeleton2D
    except ImportError as e:
        raise ConfigError(
            "the parameter rep155 needs the package hri_msgs, which is not installed; run: "
            "bash launch_scripts/setup.sh, or with ROS from apt install ros-jazzy-hri-msgs"
        ) from e
    return IdsList, Skeleton2D, NormalizedPointOfInterest2D
