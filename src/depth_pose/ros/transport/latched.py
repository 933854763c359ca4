"""A topic that may be sent with every frame, or once and latched."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from depth_pose.ros.transport.intake import NO_EVENTS


class LatchedTopic:
    """One subscription, with a QoS that every publisher of the topic can serve.

    Best effort and volatile suits all of them, but earlier messages are not received. If all publishers
    are latched (transient local), the subscription requests it as well. A QoS that one of them cannot
    serve would be reported on their side, and by ``ros2 doctor``.

    Parameters
    ----------
    node : Node
    kind, topic
        Message class and name.
    callback : callable
        Receives every message.
    depth : int
        Number of senders with one latched message each.
    """

    def __init__(
        self, node: Node, kind: type, topic: str, callback: Callable[[Any], None], depth: int
    ) -> None:
        self._node, self._kind, self._topic = node, kind, topic
        self._callback, self._depth = callback, depth
        self._is_kept = self._is_reliable = False
        self._subscription = self._open()

    def check(self) -> None:
        """Check the publishers and resubscribe if they need another QoS; called periodically."""
        found = [
            p.qos_profile for p in self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        ]
        if not found:
            return
        kept = all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in found)
        reliable = kept and all(q.reliability == ReliabilityPolicy.RELIABLE for q in found)
        if (kept, reliable) != (self._is_kept, self._is_reliable):
            self._is_kept, self._is_reliable = kept, reliable
            self.close()
            self._subscription = self._open()

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)

    def _open(self) -> Subscription:
        kept, reliable = self._is_kept, self._is_reliable
        qos = QoSProfile(
            depth=self._depth,
            history=HistoryPolicy.KEEP_LAST,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
        )
        return self._node.create_subscription(
            self._kind, self._topic, self._callback, qos, event_callbacks=NO_EVENTS
        )
