"""Report topics without messages, without a publisher, or with several."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from depth_pose.core.printable import printable
from depth_pose.ros.process.shared_memory import other_account_advice
from depth_pose.ros.transport.depth_sources import depth_sources
from depth_pose.ros.transport.intake import Input, type_name
from depth_pose.ros.transport.losses import packet_loss_advice

MISSING_AFTER_S = 1.9
"""Seconds after which a topic with publishers but without any message counts as missing.
With a check every half second, the warning comes within three seconds.
"""

PAUSED_AFTER_S = 5.0
"""Seconds of silence after which a topic counts as missing, or three of its own periods if longer.
"""

REPEAT_S = 10.0
"""Seconds after which the warning is repeated while the input is missing."""

SEVERAL_AFTER_S = 8.0
"""Seconds after which several publishers give a warning.
More than the 5 s for which Fast DDS keeps a killed one (`fastdds.xml`, leaseDuration).
"""


class PublisherWatch:
    """Warns of topics with several publishers, whose frames would mix; call `check` once a second."""

    def __init__(self, node: Node, inputs: Sequence[Input]) -> None:
        self._node = node
        self._since: dict[str, float | None] = {i.topic: None for i in inputs}

    def check(self) -> None:
        """Warn, repeatedly, if more than one has published for some time."""
        now = time.monotonic()
        for topic, since in self._since.items():
            count = self._node.count_publishers(topic)
            if count < 2:
                self._since[topic] = None
            elif since is None:
                self._since[topic] = now
            elif now - since >= SEVERAL_AFTER_S:
                self._since[topic] = now
                self._node.get_logger().warning(
                    f"{topic} has {count} publishers, and their frames mix; does another suite run in "
                    "this domain? Give it a namespace (-r __ns:=/other) or a ROS_DOMAIN_ID of its own"
                )


@dataclass
class _Watched:
    type_names: tuple[str, ...]
    published: float | None = None
    last_s: float | None = None
    period: float = 0.0
    warned: float = -1e9


class MissingInputWatch:
    """Watches the inputs from outside the suite; call `check` twice a second.

    Attributes
    ----------
    missing : list of str
        Topics without messages or publishers.
    """

    def __init__(self, node: Node, inputs: Sequence[Input], *, reliable: bool = False) -> None:
        self.missing: list[str] = []
        self._node, self._reliable = node, reliable
        self._started = time.monotonic()
        self._watched = {
            i.topic: _Watched(tuple(map(type_name, (i.kind, *i.others)))) for i in inputs if i.sensor
        }

    def on_message(self, topic: str) -> None:
        """Record a message."""
        watched = self._watched.get(topic)
        if watched is not None:
            now = time.monotonic()
            if watched.last_s is not None:
                watched.period = now - watched.last_s
            watched.last_s = now

    def check(self) -> None:
        """Warn about every missing topic; called twice a second, it does so within three seconds."""
        now = time.monotonic()
        self.missing = []
        for topic, watched in self._watched.items():
            patience = MISSING_AFTER_S
            if watched.last_s is not None:
                patience = max(PAUSED_AFTER_S, 3.0 * watched.period)
                if now - watched.last_s < patience:
                    continue
            found = self._node.get_publishers_info_by_topic(topic)
            if bool(found) != (watched.published is not None):  # publishers appeared or left
                watched.published = now if found else None
            since = max(watched.published or self._started, watched.last_s or self._started)
            if now - since < patience:
                continue
            self.missing.append(topic)
            if now - watched.warned >= REPEAT_S:
                watched.warned = now
                self._node.get_logger().warning(printable(self._explain(topic, watched, found, now - since)))

    def _explain(self, topic: str, watched: _Watched, found: Sequence[object], missing_s: float) -> str:
        wanted = watched.type_names[0]
        sources = depth_sources(self._node) if self._node.has_parameter("image_topic") else []
        if not found:
            there = "; ".join(str(source) for source in sources)
            hint = f"; depth may come from, with these parameters: {there}" if there else ""
            return printable(f"nobody publishes {topic} ({wanted}){hint}")
        types = sorted({p.topic_type for p in found})  # type: ignore[attr-defined]
        start = f"{topic} has {len(found)} publisher(s) but nothing came for {missing_s:.0f} s: "
        if len(types) > 1 or types[0] not in watched.type_names:
            how = "; ".join(str(source) for source in sources if source.topic == topic)
            hint = f"; name it by its parameters, without a remap: {how}" if how else ""
            return printable(f"{start}it carries {', '.join(types)}, this node takes {wanted}{hint}")
        qos = [p.qos_profile for p in found]  # type: ignore[attr-defined]
        if self._reliable and all(q.reliability == ReliabilityPolicy.BEST_EFFORT for q in qos):
            return start + "it is sent best effort, this node asks for reliable: leave the parameter reliable"
        durable = any(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in qos)
        if durable:
            return start + "it is published once and kept; a depth topic must stream"
        advice = other_account_advice() if watched.last_s is None else ""
        lost = f"the sensor may be paused, or its frames are lost in transport: {packet_loss_advice()}"
        return start + (advice or lost)
