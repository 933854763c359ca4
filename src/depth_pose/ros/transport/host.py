"""What sources and publishers of this folder ask of the node that they belong to.

The nodes are `depth_pose.ros.nodes.topic_node.TopicNode` and `depth_pose.ros.nodes.node_base.StageNode`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from depth_pose.ros.transport.losses import BusyTimes


class TopicHost(Protocol):
    """A node with parameters that opens topics, and closes them together.

    Attributes
    ----------
    get_logger
        Method of rclpy's Node.
    """

    get_logger: Callable[[], Any]

    def value(self, name: str) -> Any:
        """Value of a parameter."""

    def latch(self, kind: type, topic: str, callback: Callable[[Any], None], depth: int = 1) -> None:
        """Subscribe to a topic sent with every frame, or once and latched, by up to ``depth`` senders."""

    def open_publisher(self, kind: type, topic: str, qos: QoSProfile | int) -> Publisher:
        """Create a publisher that is not an output of frames; it closes with the others."""


class FrameConsumer(Protocol):
    """A node that processes frames.

    Attributes
    ----------
    lossless : bool
        Whether it processes every frame in turn; else the newest wins.
    queue : int
        Frames that may wait.
    is_active : bool
        Whether frames are answered.
    busy : BusyTimes
        Intervals in which it was busy with a frame, or with new settings.
    create_subscription, destroy_subscription, create_timer, destroy_timer, resolve_topic_name
    count_publishers, get_publishers_info_by_topic, get_logger
        Methods of rclpy's Node.
    """

    lossless: bool
    queue: int
    is_active: bool
    busy: BusyTimes
    create_subscription: Callable[..., Subscription]
    destroy_subscription: Callable[[Subscription], bool]
    create_timer: Callable[..., Any]
    destroy_timer: Callable[[Any], bool]
    resolve_topic_name: Callable[[str], str]
    count_publishers: Callable[[str], int]
    get_publishers_info_by_topic: Callable[[str], list[Any]]
    get_logger: Callable[[], Any]

    def on_message(self, topic: str) -> None:
        """Record the arrival of a message."""

    def count(self, what: str, count: int = 1) -> None:
        """Count events that are not drops."""

    def drop(self, reason: str, detail: str, count: int = 1) -> None:
        """Count frames without an answer."""

    def process(self, messages: tuple[Any, ...]) -> None:
        """Process a complete frame."""

    def guard(self, topic: str, call: Callable[..., None], *arguments: Any) -> None:
        """Call the handler; log exceptions instead of raising."""
