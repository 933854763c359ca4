"""Inspect topics from a terminal: message rates, and transforms of frames.

Counterparts of ``ros2 topic hz`` and ``tf2_echo`` for machines without ROS from apt.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.rooms.transform_tree import TransformTree, pose_matrix
from depth_pose.ros.messages.basics import stamp_to_ns
from depth_pose.ros.tools.listener import listener, wait_until
from depth_pose.ros.tools.message_text import message_class
from depth_pose.ros.transport.tf import LATCHED, TF_QUEUE, tf_message


@dataclass(frozen=True)
class Rate:
    """Message rate of a topic since the last report.

    Attributes
    ----------
    hz : float
        Messages a second.
    low_s, high_s, deviation_s : float
        Shortest, longest and standard deviation of the gaps between them.
    count : int
        Messages.
    """

    hz: float
    low_s: float
    high_s: float
    deviation_s: float
    count: int


@dataclass(frozen=True)
class Place:
    """Transform of a frame in another.

    Attributes
    ----------
    stamp_ns : int
        Stamp of its newest message.
    T_parent_frame : (4, 4) float64
        Metres.
    """

    stamp_ns: int
    T_parent_frame: NDArray[np.float64]

    @property
    def quat_xyzw(self) -> NDArray[np.float64]:
        """The rotation, (4,)."""
        return matrix_to_quat(self.T_parent_frame[:3, :3]).ravel()

    @property
    def rpy_deg(self) -> NDArray[np.float64]:
        """Roll, pitch and yaw about the fixed x, y and z, degrees, (3,)."""
        R = self.T_parent_frame[:3, :3]
        pitch = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0))
        return np.degrees([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def watch_rate(topic: str, every_s: float = 1.0) -> Iterator[Rate | None]:
    """Yield the message rate of a topic until SIGINT or SIGTERM; None without messages.

    It begins with the first message, or after the time limit of discovery. Subscribes best effort, which
    receives from every publisher.

    Raises
    ------
    InputError
        If the topic's type is not installed here.
    """
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    times: list[float] = []
    qos = QoSProfile(depth=TF_QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
    with listener("hz") as (node, turns):

        def listen() -> bool:
            kinds = dict(node.get_topic_names_and_types()).get(topic)
            if not kinds:
                return False
            kind = message_class(kinds[0])
            node.create_subscription(kind, topic, lambda _: times.append(time.monotonic()), qos, raw=True)
            return True

        is_listening = wait_until(listen, turns)
        if is_listening:
            wait_until(lambda: bool(times), turns)
        last = times[-1] if times else None
        times.clear()
        for _ in turns(every_s):
            is_listening = is_listening or listen()
            gaps = np.diff(times if last is None else [last, *times])
            last = times[-1] if times else last
            told = None
            if len(gaps):
                told = Rate(1.0 / max(gaps.mean(), 1e-9), gaps.min(), gaps.max(), gaps.std(), len(times))
            times.clear()
            yield told


class _Heard:
    """Transforms from ``/tf`` and ``/tf_static``."""

    def __init__(self) -> None:
        self.tree = TransformTree()
        self.stamps: dict[str, int] = {}

    def take(self, message: Any) -> None:
        for t in message.transforms:
            p, q = t.transform.translation, t.transform.rotation
            try:
                T = pose_matrix([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
            except ConfigError:  # some senders put a zero quaternion
                continue
            self.tree.add(t.header.frame_id, t.child_frame_id, T)
            self.stamps[t.child_frame_id.lstrip("/")] = stamp_to_ns(t.header.stamp)


def watch_frame(frame: str, parent: str, every_s: float = 1.0) -> Iterator[Place | None]:
    """Yield the transform of a frame until SIGINT or SIGTERM; None while it is unknown.

    It uses the newest transform of each frame, as tf2 does for time 0.

    Raises
    ------
    ConfigError
        If `tf2_msgs` is not installed.
    """
    with _frames() as (heard, turns):
        for _ in turns(every_s):
            T = heard.tree.find(parent, frame)
            yield None if T is None else Place(heard.stamps.get(frame.lstrip("/"), 0), T)


def list_frames(seconds: float) -> dict[str, str]:
    """Return all frames received in a period, each with its parent."""
    with _frames() as (heard, turns):
        wait_until(lambda: bool(heard.stamps), turns)
        next(turns(seconds), None)
        return heard.tree.parents()


@contextmanager
def _frames() -> Iterator[Any]:
    message, heard = tf_message("looking at frames"), _Heard()
    with listener("tf") as (node, turns):
        node.create_subscription(message, "/tf", heard.take, TF_QUEUE)
        node.create_subscription(message, "/tf_static", heard.take, LATCHED)
        yield heard, turns
