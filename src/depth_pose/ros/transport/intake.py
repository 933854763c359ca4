"""Receive the frames of a node from its topic: newest first, losses counted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from depth_pose.core.errors import DepthPoseError
from depth_pose.core.stamps import is_late
from depth_pose.ros.messages.basics import stamp_to_ns
from depth_pose.ros.transport.host import FrameConsumer
from depth_pose.ros.transport.losses import count_lost, packet_loss_advice

RELIABLE_DEPTH = 4
"""Queue length for a reliable sensor: resent frames arrive with the next. The newest is answered."""

_SAME_PUBLISHER = 5
"""Number of messages with increasing numbers that prove a single publisher, since a killed driver stays
listed for 20 s."""

NO_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
"""No event callbacks: each makes every wait of the executor longer, and nodes report problems themselves."""

LOG_EVERY_S = 5.0
"""Minimum time between log messages of the same kind, seconds."""


@dataclass(frozen=True)
class Input:
    """One topic of a node.

    Attributes
    ----------
    kind : type
        Message class, with a header.
    topic : str
    sensor : bool
        Whether it comes from outside the suite: then its silence gives a warning.
    others : tuple of type
        Message classes that are taken instead where the publishers send one of them.
    """

    kind: type
    topic: str
    sensor: bool = False
    others: tuple[type, ...] = ()


class FrameSource(Protocol):
    """Interface of a node's source of frames: `Intake`, or one of the node's own."""

    inputs: tuple[Input, ...]
    arrivals: int

    @property
    def joined(self) -> bool:
        """Whether a publisher of every topic of this suite was discovered."""

    @property
    def has_pending(self) -> bool:
        """Whether a complete frame waits."""

    def check(self) -> None:
        """Adapt the subscriptions to their publishers; called periodically."""

    def take_waiting(self) -> bool:
        """Receive all waiting messages; return whether there were any."""

    def take_pending(self) -> tuple[Any, ...] | None:
        """Return the newest complete frame, once."""

    def forget(self) -> None:
        """Drop what waits and what is known of earlier messages."""

    def close(self) -> None:
        """Unsubscribe."""


class Drop(DepthPoseError):
    """Raised by `StageNode.answer` if a frame has no answer, with the reason for the count."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason


class Deferred(Exception):
    """Raised by `StageNode.answer` if a frame is kept and answered later."""


def frame_qos(depth: int, reliable: bool) -> QoSProfile:
    """Return the QoS of frames: the newest ``depth``, best effort as for sensors, or reliable."""
    policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=depth, history=HistoryPolicy.KEEP_LAST, reliability=policy)


def is_sent_reliable(node: FrameConsumer, topic: str) -> bool | None:
    """Whether all publishers of a topic are reliable; None without publishers."""
    found = node.get_publishers_info_by_topic(topic)
    return all(p.qos_profile.reliability == ReliabilityPolicy.RELIABLE for p in found) if found else None


def type_name(kind: type) -> str:
    """Return the name of a message class as the graph has it: ``sensor_msgs/msg/Image``."""
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"


def sent_kind(node: FrameConsumer, wanted: Input) -> type | None:
    """Return the class of an input that its publishers send; None where they send none, or several."""
    types = {p.topic_type for p in node.get_publishers_info_by_topic(wanted.topic)}
    return next((kind for kind in (wanted.kind, *wanted.others) if types == {type_name(kind)}), None)


def waiting(subscription: Subscription) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Return the messages in a subscription's queue, with their metadata."""
    handle = subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, subscription.raw)) is not None:
            yield taken


class Intake:
    """The subscription of a node of which each message is a frame.

    All waiting messages are received before the newest is begun. A lossless node begins every frame in turn.
    While the node is not active, messages are ignored.

    Attributes
    ----------
    inputs : tuple of Input
        The one topic, with its full name.
    arrivals : int
        Number of messages received.
    """

    def __init__(self, node: FrameConsumer, wanted: Input) -> None:
        self._node = node
        self._lossless = node.lossless
        self._input = replace(wanted, topic=node.resolve_topic_name(wanted.topic))
        self.inputs: tuple[Input, ...] = (self._input,)
        self.arrivals = 0
        self.forget()
        self._is_reliable = self._lossless
        self._subscription: Subscription | None = self._subscribe()

    def forget(self) -> None:
        """Drop what waits and what is known of earlier messages."""
        self._pending: Any = None
        self._last_stamp_ns: int | None = None
        self._last_taken: dict[str, Any] | None = None
        self._grown = 0

    def _subscribe(self) -> Subscription:
        resends = self._is_reliable and not self._lossless
        depth = max(self._node.queue, RELIABLE_DEPTH) if resends else self._node.queue
        kind = sent_kind(self._node, self._input) or self._input.kind
        return self._node.create_subscription(
            kind,
            self._input.topic,
            self.take,
            frame_qos(depth, self._is_reliable),
            event_callbacks=NO_EVENTS,
        )

    def check(self) -> None:
        """Subscribe to a sensor with its publishers' type and reliability.

        A reliable publisher resends messages that a best-effort subscriber would lose.
        """
        wanted, before = self._input, self._subscription
        assert before is not None
        reliable = (
            is_sent_reliable(self._node, wanted.topic) if wanted.sensor and not self._lossless else None
        )
        kind = sent_kind(self._node, wanted) if wanted.others else None
        if reliable in (None, self._is_reliable) and kind in (None, before.msg_type):
            return
        self._is_reliable = self._is_reliable if reliable is None else reliable
        self._node.destroy_subscription(before)
        self._last_taken = None
        self._subscription = self._subscribe()

    def close(self) -> None:
        """Unsubscribe."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    @property
    def joined(self) -> bool:
        """Whether a publisher was discovered, if the topic is one of this suite."""
        subscription = self._subscription
        return self._input.sensor or (subscription is not None and subscription.get_publisher_count() > 0)

    @property
    def has_pending(self) -> bool:
        """Whether a frame waits."""
        return self._pending is not None

    def take_waiting(self) -> bool:
        """Receive messages that arrived meanwhile, without waiting; return whether there were any."""
        before = self.arrivals
        if self._subscription is not None:
            for message, info in waiting(self._subscription):
                self.take(message, info)
        return self.arrivals > before

    def take_pending(self) -> tuple[Any, ...] | None:
        """Return the newest frame, once."""
        message, self._pending = self._pending, None
        return None if message is None else (message,)

    def take(self, message: Any, info: Any) -> None:
        """Receive a message with rclpy's message info; log exceptions."""
        self._node.guard(self._input.topic, self._add, message, info)

    def _add(self, message: Any, info: dict[str, Any]) -> None:
        self.arrivals += 1
        self._node.on_message(self._input.topic)
        if not self._node.is_active:
            self._node.count("ignored while paused")
            return
        self._count_missed(info)
        if not self._is_new(stamp_to_ns(message.header.stamp)):
            return
        if self._lossless or not self._is_reliable:
            self._node.process((message,))
            return
        if self._pending is not None:
            self._node.drop("overtaken", "a newer frame came before this one was begun")
        self._pending = message

    def _count_missed(self, info: dict[str, Any]) -> None:
        """Count messages that were sent and never received, by the publisher's sequence numbers."""
        sequence = info.get("publication_sequence_number")
        if not sequence:
            return
        last, self._last_taken = self._last_taken, info
        topic = self._input.topic
        if last is None or sequence <= last["publication_sequence_number"]:
            self._grown = 0
            return
        self._grown += 1
        if sequence == last["publication_sequence_number"] + 1:
            return
        # each publisher has its own numbers: those of several cannot be compared
        if self._grown < _SAME_PUBLISHER and self._node.count_publishers(topic) != 1:
            return
        busy, lost = count_lost(last, info, self._node.busy)
        if busy:
            self._node.drop("missed", f"{topic} brought newer ones while this node was busy", busy)
        if lost:
            what = f"{topic} sent it, and it never came though this node waited"
            if self._input.sensor:
                what += f": {packet_loss_advice()}"
            self._node.drop("lost in transport", what, lost)

    def _is_new(self, stamp_ns: int) -> bool:
        last, self._last_stamp_ns = self._last_stamp_ns, stamp_ns
        if last is None or stamp_ns > last:
            return True
        topic = self._input.topic
        if stamp_ns == last:
            what = f"{topic} repeats stamp {stamp_ns} ns; does the driver set header.stamp?"
            self._node.drop("same stamp", what)
            return False
        self._node.count("stamps going back")
        then = "a late frame is skipped" if is_late(stamp_ns, last) else "earlier frames are forgotten"
        self._node.get_logger().warning(
            f"the stamps of {topic} went back by {(last - stamp_ns) / 1e9:.3f} s; {then}",
            throttle_duration_sec=LOG_EVERY_S,
        )
        return True
