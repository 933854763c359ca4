"""Transforms on ``/tf`` and ``/tf_static``: messages, publishers, and who is where."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Transform, TransformStamped, Vector3
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, QoSProfile

from depth_pose.core.errors import ConfigError
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.core.skeleton import JOINTS
from depth_pose.core.types import Skeleton
from depth_pose.ros.transport.conversions import make_header

if TYPE_CHECKING:
    from depth_pose.ros.nodes.node_base import StageNode

TF_QUEUE = 100
"""Messages of ``/tf`` that wait for a slow listener; tf2's own depth."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS of ``/tf_static`` and of what seldom changes: who comes late gets what was sent last."""


def tf_message(what: str) -> Any:
    """Import ``tf2_msgs/msg/TFMessage``.

    Parameters
    ----------
    what : str
        What needs it, for the error.

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
    node : StageNode
    what : str
        What needs it, for the error where `tf2_msgs` is missing.
    static : bool
        On ``/tf_static``; what was told before is told again: who comes late hears only the last message.
    """

    def __init__(self, node: StageNode, what: str, static: bool = False) -> None:
        self._message = tf_message(what)
        self._told: dict[str, TransformStamped] = {}
        self._static = static
        topic, qos = ("/tf_static", LATCHED) if static else ("/tf", TF_QUEUE)
        self._publisher = node.open_publisher(self._message, topic, qos)

    def tell(self, transforms: Iterable[TransformStamped]) -> None:
        """Publish them in one message."""
        told = list(transforms)
        if self._static:
            self._told.update((t.child_frame_id, t) for t in told)
            told = list(self._told.values())
        self._publisher.publish(self._message(transforms=told))


def stamped(stamp_ns: int, parent: str, child: str, T_parent_child: NDArray[np.float64]) -> TransformStamped:
    """Message of a transform (4, 4)."""
    x, y, z = T_parent_child[:3, 3].tolist()
    return TransformStamped(
        header=make_header(stamp_ns, parent),
        child_frame_id=child,
        transform=Transform(translation=Vector3(x=x, y=y, z=z), rotation=_quaternion(T_parent_child[:3, :3])),
    )


def pose_of(T: NDArray[np.float64]) -> Pose:
    """Message of a pose (4, 4)."""
    x, y, z = T[:3, 3].tolist()
    return Pose(position=Point(x=x, y=y, z=z), orientation=_quaternion(T[:3, :3]))


def _quaternion(rotation: NDArray[np.float64]) -> Quaternion:
    x, y, z, w = matrix_to_quat(rotation).ravel().tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def skeletons_to_transforms(
    skeletons: Sequence[Skeleton], followed: Skeleton, prefix: str = ""
) -> list[TransformStamped]:
    """Camera frame to every joint of everybody, named ``BODY_ID_joint``; of the one followed also ``joint``.

    Parameters
    ----------
    skeletons : sequence of Skeleton
    followed : Skeleton
        May be lost.
    prefix : str
        Put before all names.
    """
    out = _transforms(followed, prefix)
    for skeleton in skeletons:
        out += _transforms(skeleton, f"{prefix}{skeleton.body_id}_")
    return out


def _transforms(skeleton: Skeleton, prefix: str) -> list[TransformStamped]:
    header = make_header(skeleton.stamp_ns, skeleton.frame_id)
    rows = zip(JOINTS, skeleton.positions.tolist(), skeleton.quats_xyzw.tolist(), strict=False)
    return [
        TransformStamped(
            header=header,
            child_frame_id=prefix + name,
            transform=Transform(
                translation=Vector3(x=p[0], y=p[1], z=p[2]),
                rotation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3]),
            ),
        )
        for name, p, q in rows
    ]
