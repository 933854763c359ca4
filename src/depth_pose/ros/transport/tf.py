"""Transforms on ``/tf`` and ``/tf_static``: messages, publishers, and frames of people."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Transform, TransformStamped, Vector3
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header

from depth_pose.core.errors import ConfigError
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import JOINTS
from depth_pose.ros.messages.basics import make_header
from depth_pose.ros.transport.host import TopicHost

TF_QUEUE = 100
"""Queue length of ``/tf``; that of tf2."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS of ``/tf_static`` and of rare messages: late subscribers get the last one."""


def tf_message(what: str) -> Any:
    """Import ``tf2_msgs/msg/TFMessage``.

    Parameters
    ----------
    what : str
        Feature that needs it, for the error.

    Raises
    ------
    ConfigError
        If the package is not installed.
    """
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError as e:
        raise ConfigError(
            f"{what} needs the package tf2_msgs, which is not installed; run: bash launch_scripts/setup.sh, "
            "or with ROS from apt install ros-jazzy-tf2-msgs"
        ) from e
    return TFMessage


class Transforms:
    """Publishes transforms.

    Parameters
    ----------
    node : TopicHost
    what : str
        Feature that needs it, for the error if `tf2_msgs` is missing.
    static : bool
        On ``/tf_static``; each message repeats all transforms: late subscribers get only the last one.
    """

    def __init__(self, node: TopicHost, what: str, static: bool = False) -> None:
        self._message = tf_message(what)
        self._sent: dict[str, TransformStamped] = {}
        self._static = static
        topic, qos = ("/tf_static", LATCHED) if static else ("/tf", TF_QUEUE)
        self._publisher = node.open_publisher(self._message, topic, qos)

    @property
    def is_heard(self) -> bool:
        """Whether there is a subscriber."""
        return bool(self._publisher.get_subscription_count())

    def publish(self, transforms: Iterable[TransformStamped]) -> None:
        """Publish them in one message."""
        sent = list(transforms)
        if self._static:
            self._sent.update((t.child_frame_id, t) for t in sent)
            sent = list(self._sent.values())
        self._publisher.publish(self._message(transforms=sent))


def stamped(stamp_ns: int, parent: str, child: str, T_parent_child: NDArray[np.float64]) -> TransformStamped:
    """Build the message of a transform (4, 4)."""
    return stamped_all(stamp_ns, parent, [child], T_parent_child[None])[0]


def stamped_all(
    stamp_ns: int, parent: str, children: Sequence[str], T_parent_child: NDArray[np.float64]
) -> list[TransformStamped]:
    """Build the messages of several transforms (N, 4, 4) in one frame."""
    header = make_header(stamp_ns, parent)
    quats = matrix_to_quat(T_parent_child[:, :3, :3])
    rows = zip(children, T_parent_child[:, :3, 3].tolist(), quats.tolist(), strict=True)
    return [_transform(header, name, place, quat) for name, place, quat in rows]


def _transform(header: Header, child: str, place: list[float], quat_xyzw: list[float]) -> TransformStamped:
    (x, y, z), (a, b, c, d) = place, quat_xyzw
    return TransformStamped(
        header=header,
        child_frame_id=child,
        transform=Transform(translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=a, y=b, z=c, w=d)),
    )


def pose_of(T: NDArray[np.float64]) -> Pose:
    """Build the message of a pose (4, 4)."""
    (x, y, z), (a, b, c, d) = T[:3, 3].tolist(), matrix_to_quat(T[:3, :3]).ravel().tolist()
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=a, y=b, z=c, w=d))


def skeletons_to_transforms(
    skeletons: Sequence[Skeleton], followed: Skeleton, prefix: str = ""
) -> list[TransformStamped]:
    """Camera frame to every person's joints, named ``BODY_ID_joint``; for the followed person also ``joint``.

    Parameters
    ----------
    skeletons : sequence of Skeleton
    followed : Skeleton
        May be lost.
    prefix : str
        Prefix of all names.
    """
    out = _transforms(followed, prefix)
    for skeleton in skeletons:
        out += _transforms(skeleton, f"{prefix}{skeleton.body_id}_")
    return out


def _transforms(skeleton: Skeleton, prefix: str) -> list[TransformStamped]:
    header = make_header(skeleton.stamp_ns, skeleton.frame_id)
    rows = zip(JOINTS, skeleton.positions.tolist(), skeleton.quats_xyzw.tolist(), strict=False)
    return [_transform(header, prefix + name, p, q) for name, p, q in rows]
