"""The topics of a node: publishers, subscriptions, bad messages, and its diagnostics once a second.

No message ends a node: bad messages and unexpected errors are counted, logged at a limited rate, and reported
on ``/diagnostics``.
"""

from __future__ import annotations

import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.lifecycle import LifecycleNode
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from depth_pose.core.errors import ConfigError, InputError, raise_if_interrupted
from depth_pose.core.options import Sections
from depth_pose.core.printable import printable, printable_lines
from depth_pose.ros.nodes.parameters import COMMON, declare
from depth_pose.ros.nodes.statistics import NodeStatistics
from depth_pose.ros.process.shared_memory import keep_private
from depth_pose.ros.setting import Setting
from depth_pose.ros.transport.intake import LOG_EVERY_S, NO_EVENTS, frame_qos
from depth_pose.ros.transport.latched import LatchedTopic

BUSY_REASONS = ("overtaken", "missed")
"""Reasons of drops that come of a machine that is too slow."""

BUSY_EVERY_S = 60.0
"""Seconds between two lines about a machine that is too slow."""


class TopicNode(LifecycleNode, ABC):
    """A managed node that opens and closes its topics together, and counts frames without an answer.

    Attributes
    ----------
    statistics : NodeStatistics
        Counts and times that go to ``/diagnostics``.
    lossless : bool
        Parameter ``reliable``: whether every frame is processed.
    queue : int
        Parameter ``queue``: frames that may wait.
    LOGS_BUSY : bool
        Whether it logs drops for `BUSY_REASONS`; where another node sums them up they are only counted.
    """

    LOGS_BUSY: ClassVar[bool] = True

    def __init__(
        self, name: str, settings: Sequence[Setting], sections: Sequence[str], config: type[Sections]
    ) -> None:
        super().__init__(name, namespace="depth_pose")
        keep_private()
        self.statistics = NodeStatistics()
        self._logged: dict[str, tuple[float, int]] = {}
        self._outputs: list[Publisher] = []
        self._sources: list[Subscription] = []
        self._opened: list[Publisher | Subscription] = []
        self._latched: list[LatchedTopic] = []
        declare(self, (*COMMON, *settings), sections, config)
        self.lossless: bool = self.value("reliable")
        self.queue: int = self.value("queue")
        self.steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def value(self, name: str) -> Any:
        """Value of a parameter."""
        return self.get_parameter(name).value

    def publisher(self, kind: type, topic: str, *, reliable: bool = False, counted: bool = True) -> Publisher:
        """Create a publisher of frames: sensor QoS, or `reliable`, which suits every subscriber.

        Parameters
        ----------
        kind, topic
            Message class, and a name below the node's namespace.
        reliable : bool
            For small messages to other programs.
        counted : bool
            Whether its subscribers count for the parameter ``consumers``.
        """
        qos = frame_qos(self.queue, reliable or self.lossless)
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        made = self.create_publisher(kind, topic, qos, event_callbacks=quiet)
        self._opened.append(made)
        if counted:
            self._outputs.append(made)
        return made

    def open_publisher(self, kind: type, topic: str, qos: QoSProfile | int) -> Publisher:
        """Create a publisher that is not an output of frames; it closes with the others."""
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        made = self.create_publisher(kind, topic, qos, event_callbacks=quiet)
        self._opened.append(made)
        return made

    def close_publisher(self, publisher: Publisher) -> None:
        """Close a publisher of `open_publisher`."""
        self._opened.remove(publisher)
        self.destroy_publisher(publisher)

    def listen(
        self, kind: type, topic: str, callback: Callable[[Any], None], *, raw: bool = False
    ) -> Subscription:
        """Subscribe to a topic of the suite that is not part of a frame; with ``raw`` as bytes."""
        qos = frame_qos(self.queue, self.lossless)
        made = self.create_subscription(
            kind, topic, partial(self.guard, topic, callback), qos, event_callbacks=NO_EVENTS, raw=raw
        )
        self._opened.append(made)
        self._sources.append(made)
        return made

    def latch(self, kind: type, topic: str, callback: Callable[[Any], None], depth: int = 1) -> None:
        """Subscribe to a topic sent with every frame, or once and latched, by up to ``depth`` senders."""
        take = partial(self.guard, topic, callback)
        self._latched.append(LatchedTopic(self, kind, topic, take, depth))

    def guard(self, topic: str, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call the handler of a message and return its result; count bad messages instead of raising."""
        try:
            return call(*arguments)
        except ConfigError:  # the settings are wrong, not the message
            raise
        except InputError as e:
            self.drop("bad input", f"{topic}: {e}")
        except Exception as e:
            self.survive(e, topic)
        return None

    def survive(self, error: Exception, where: str) -> None:
        """Log and count an unexpected error, unless it is caused by a stop signal."""
        raise_if_interrupted(error)
        if self.context.ok():
            self.get_logger().error(
                printable_lines(traceback.format_exc()), throttle_duration_sec=LOG_EVERY_S
            )
            self.drop("error", f"{where}: {type(error).__name__}: {error}")

    def drop(self, reason: str, detail: str, count: int = 1) -> None:
        """Count frames without an answer, and log them at a limited rate."""
        self.statistics.drop(reason, count)
        is_busy = reason in BUSY_REASONS
        if is_busy and not self.LOGS_BUSY:
            return
        last, before = self._logged.get(reason, (-1e9, 0))
        now, total = time.monotonic(), self.statistics.drops[reason]
        if now - last < (BUSY_EVERY_S if is_busy else LOG_EVERY_S):
            return
        self._logged[reason] = (now, total)
        more = f" ({total - before} of these since the last such line)" if total - before > 1 else ""
        self.get_logger().warning(f"dropped, {reason}: {printable(detail)}{more}")

    def count(self, what: str, count: int = 1) -> None:
        """Count events for the diagnostics that are not drops."""
        self.statistics.counts[what] += count

    def close_topics(self) -> None:
        """Close all topics."""
        for entity in self._opened:
            if isinstance(entity, Publisher):
                self.destroy_publisher(entity)
            else:
                self.destroy_subscription(entity)
        for topic in self._latched:
            topic.close()
        self._opened, self._outputs, self._sources, self._latched = [], [], [], []

    def check_latched(self) -> None:
        """Renew subscriptions if a latched topic's publisher changed its QoS; called twice a second."""
        for topic in self._latched:
            topic.check()

    @property
    def is_joined(self) -> bool:
        """Whether the outputs have their ``consumers``, and with ``producers`` the inputs a publisher."""
        wanted = self.value("consumers")
        joined = all(p.get_subscription_count() >= wanted for p in self._outputs)
        if self.value("producers"):
            joined = joined and all(s.get_publisher_count() for s in self._sources)
        return joined

    @abstractmethod
    def judge(self) -> tuple[bytes, str]:
        """Return level and text of this second's diagnostics."""

    def more_statuses(self) -> list[DiagnosticStatus]:
        """Return further statuses for ``/diagnostics``, beside that of the node."""
        return []

    def publish_diagnostics(self) -> None:
        """Publish level, text, counts and times on ``/diagnostics``; called once a second."""
        status = DiagnosticStatus(name=self.get_fully_qualified_name(), hardware_id="depth_pose")
        status.level, status.message = self.judge()
        self.statistics.counts["listeners"] = min(
            (p.get_subscription_count() for p in self._outputs), default=0
        )
        status.values = [KeyValue(key=k, value=v) for k, v in self.statistics.as_text().items()]
        message = DiagnosticArray(status=[status, *self.more_statuses()])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
