"""Group the images of several cameras to sets of views: by stamp, newest first."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.subscription import Subscription
from sensor_msgs.msg import Image

from depth_pose.core.errors import InputError
from depth_pose.io.messages import read_image
from depth_pose.ros.transport.host import FrameConsumer
from depth_pose.ros.transport.intake import (
    LOG_EVERY_S,
    NO_EVENTS,
    Input,
    frame_qos,
    is_sent_reliable,
    waiting,
)
from depth_pose.volume.synchroniser import Synchroniser, ViewSet

_QUEUE = 8
"""Queue length of each camera: all images are received, so that dropped sets are counted."""


_TOGETHER_S, _DOZE_S = 0.001, 0.0002
"""Time within which triggered cameras deliver their images, and period of checks."""


class ViewSetIntake:
    """The subscriptions of a node with several cameras.

    With eight cameras at 60 images a second, receiving takes much of the time: a wake-up of the executor
    costs several times as much as an image. So one wake-up receives the images of all cameras, sleeping for a
    millisecond until the rest arrives; messages are received as bytes; and the timer for late cameras runs
    only during a wait.

    Parameters
    ----------
    node : FrameConsumer
    topics : sequence of str
    synchroniser : Synchroniser
    """

    def __init__(self, node: FrameConsumer, topics: Sequence[str], synchroniser: Synchroniser) -> None:
        self.inputs = tuple(Input(Image, node.resolve_topic_name(t), sensor=True) for t in topics)
        self.arrivals = 0
        self.synchroniser = synchroniser
        self._node = node
        self._pending: ViewSet | None = None
        self._reported_late = -LOG_EVERY_S
        self._numbers = [0] * len(topics)
        self._is_reliable = [node.lossless] * len(topics)
        self._subscriptions = [self._subscribe(camera) for camera in range(len(topics))]
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(self._period_s(), self._check, clock=steady)
        self._timer.cancel()

    def _subscribe(self, camera: int) -> Subscription:
        qos = frame_qos(max(_QUEUE, self._node.queue), self._is_reliable[camera])
        topic, callback = self.inputs[camera].topic, self._callback(camera)
        return self._node.create_subscription(
            Image, topic, callback, qos, raw=True, event_callbacks=NO_EVENTS
        )

    def check(self) -> None:
        """Subscribe to every camera with its publishers' reliability."""
        for camera, i in enumerate(self.inputs):
            reliable = None if self._node.lossless else is_sent_reliable(self._node, i.topic)
            if reliable is not None and reliable != self._is_reliable[camera]:
                self._is_reliable[camera] = reliable
                self._node.destroy_subscription(self._subscriptions[camera])
                self._numbers[camera] = 0
                self._subscriptions[camera] = self._subscribe(camera)

    def _period_s(self) -> float:
        """Set the period of checks whether a late camera was waited for long enough."""
        return max(self.synchroniser.config.patience / 2, _TOGETHER_S)

    @property
    def joined(self) -> bool:
        """Whether every topic of the suite has a publisher: cameras are not part of it."""
        return True

    @property
    def has_pending(self) -> bool:
        """Whether a set of views waits to be answered."""
        return self._pending is not None

    def take_pending(self) -> tuple[Any, ...] | None:
        """Return the newest set of views, once."""
        views, self._pending = self._pending, None
        return None if views is None else (views,)

    def forget(self) -> None:
        """Drop the waiting views."""
        self._pending = None
        self.synchroniser.clear()

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_timer(self._timer)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _callback(self, camera: int) -> Callable[..., None]:
        def take(data: bytes, info: dict[str, Any]) -> None:  # rclpy counts the arguments
            self._node.guard(self.inputs[camera].topic, self._add, camera, data, info)
            self._take_others()
            self._check()

        return take

    def take_waiting(self) -> bool:
        """Receive all waiting messages; return whether there were any."""
        before = self.arrivals
        self._take_all()
        self._check()
        return self.arrivals > before

    def _take_all(self) -> None:
        for camera, subscription in enumerate(self._subscriptions):
            for data, info in waiting(subscription):
                self._node.guard(self.inputs[camera].topic, self._add, camera, data, info)

    def _take_others(self) -> None:
        """Receive what all cameras sent, and what arrives within a moment."""
        while True:
            self._take_all()
            if not self.synchroniser.is_fresh(time.monotonic(), _TOGETHER_S):
                return
            time.sleep(_DOZE_S)

    def _add(self, camera: int, data: bytes, info: dict[str, Any]) -> None:
        self.arrivals += 1
        topic = self.inputs[camera].topic
        self._node.on_message(topic)
        number, last = info.get("publication_sequence_number") or 0, self._numbers[camera]
        self._numbers[camera] = number
        if last and number > last + 1:
            self._node.count(f"missed: {topic}", number - last - 1)
        if not self._node.is_active:
            self._node.count("ignored while paused")
            return
        try:
            image = read_image(data)
        except InputError as error:
            self._node.drop("bad image", f"{topic}: {error}")
            return
        late = self.synchroniser.late[camera]
        self.synchroniser.add(camera, image.stamp_ns, image, time.monotonic())
        if self.synchroniser.late[camera] > late and time.monotonic() > self._reported_late + LOG_EVERY_S:
            self._reported_late = time.monotonic()
            self._node.get_logger().warning(f"{topic} is late: its time was answered without it")

    def _check(self) -> None:
        before = self.synchroniser.overtaken
        views = self.synchroniser.take(time.monotonic(), newest=not self._node.lossless)
        if self.synchroniser.overtaken > before:
            self._overtaken(self.synchroniser.overtaken - before)
        if not self.synchroniser.is_waiting:
            self._timer.cancel()
        elif self._timer.is_canceled() or self._timer.timer_period_ns != round(1e9 * self._period_s()):
            self._timer.timer_period_ns = round(1e9 * self._period_s())
            self._timer.reset()
        if views is None:
            return
        if self._node.lossless:  # every set in turn
            while views is not None:
                self._node.process((views,))
                views = self.synchroniser.take(time.monotonic(), newest=False)
            return
        if self._pending is not None:
            self._overtaken(1)
        self._pending = views

    def _overtaken(self, count: int) -> None:
        self._node.drop("overtaken", "newer views came before this one was begun", count)
