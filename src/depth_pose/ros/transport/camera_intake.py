"""Receive the messages of several cameras as they arrive; all waiting messages form one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.subscription import Subscription

from depth_pose.ros.transport.host import FrameConsumer
from depth_pose.ros.transport.intake import (
    NO_EVENTS,
    Input,
    frame_qos,
    is_sent_reliable,
    waiting,
)

_QUEUE = 8
"""Queue length of each camera."""


class CameraIntake:
    """The subscriptions of a node that takes several cameras' messages, not paired by their stamps.

    A frame is the batch of ``(camera, message)`` that waited.

    Parameters
    ----------
    node : FrameConsumer
    kind : type
        Message class.
    topics : sequence of str
        One for each camera.
    """

    def __init__(self, node: FrameConsumer, kind: type, topics: Sequence[str]) -> None:
        self.inputs = tuple(Input(kind, node.resolve_topic_name(t)) for t in topics)
        self.arrivals = 0
        self._node = node
        self._pending: list[tuple[int, Any]] = []
        self._is_reliable = [node.lossless] * len(topics)
        self._subscriptions = [self._subscribe(camera) for camera in range(len(topics))]

    def _subscribe(self, camera: int) -> Subscription:
        qos = frame_qos(max(_QUEUE, self._node.queue), self._is_reliable[camera])
        i, callback = self.inputs[camera], self._callback(camera)
        return self._node.create_subscription(i.kind, i.topic, callback, qos, event_callbacks=NO_EVENTS)

    def check(self) -> None:
        """Subscribe to every camera with its publishers' reliability."""
        for camera, i in enumerate(self.inputs):
            reliable = None if self._node.lossless else is_sent_reliable(self._node, i.topic)
            if reliable is not None and reliable != self._is_reliable[camera]:
                self._is_reliable[camera] = reliable
                self._node.destroy_subscription(self._subscriptions[camera])
                self._subscriptions[camera] = self._subscribe(camera)

    @property
    def joined(self) -> bool:
        """Whether every topic of the suite has a publisher: cameras are not part of it."""
        return True

    @property
    def has_pending(self) -> bool:
        """Whether messages wait."""
        return bool(self._pending)

    def take_waiting(self) -> bool:
        """Receive all waiting messages; return whether there were any."""
        before = self.arrivals
        for camera, subscription in enumerate(self._subscriptions):
            for message, _ in waiting(subscription):
                self._add(camera, message)
        return self.arrivals > before

    def take_pending(self) -> tuple[Any, ...] | None:
        """Return all waiting messages, once."""
        batch, self._pending = tuple(self._pending), []
        return batch or None

    def forget(self) -> None:
        """Drop the waiting messages."""
        self._pending = []

    def close(self) -> None:
        """Unsubscribe."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _callback(self, camera: int) -> Callable[[Any], None]:
        return lambda message: self._add(camera, message)

    def _add(self, camera: int, message: Any) -> None:
        self.arrivals += 1
        self._node.on_message(self.inputs[camera].topic)
        if self._node.is_active:
            self._pending.append((camera, message))
        else:
            self._node.count("ignored while paused")
