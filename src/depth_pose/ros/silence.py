"""Say so when a sensor's topic has publishers but nothing comes, or has no publisher at all."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy

if TYPE_CHECKING:
    from depth_pose.ros.node_base import Input

SILENT_AFTER_S = 2.0
"""A topic with publishers is silent after this, or after three of its own periods."""

REPEAT_S = 10.0
"""The warning is repeated this often while the silence lasts."""


class SilenceWatch:
    """Watches the topics that come from outside; `check` is called once a second.

    Attributes
    ----------
    silent : list of str
        Topics with publishers from which nothing comes.
    """

    def __init__(self, node: Node, inputs: Sequence[Input]) -> None:
        now = time.monotonic()
        self.silent: list[str] = []
        self._node = node
        self._kinds = {i.topic: i.kind for i in inputs}
        self._heard = {i.topic: now for i in inputs}
        self._period = {i.topic: 0.0 for i in inputs}
        self._warned = {i.topic: -1e9 for i in inputs}

    def heard(self, topic: str) -> None:
        """Note a message."""
        if topic in self._heard:
            now = time.monotonic()
            self._period[topic], self._heard[topic] = now - self._heard[topic], now

    def check(self) -> None:
        """Warn about every silent topic, within three seconds of its silence."""
        now = time.monotonic()
        self.silent = []
        for topic in self._kinds:
            patience = max(SILENT_AFTER_S, 3.0 * self._period[topic])
            if now - self._heard[topic] < patience:
                continue
            found = self._node.get_publishers_info_by_topic(topic)
            if found:
                self.silent.append(topic)
            if now - self._warned[topic] >= REPEAT_S:
                self._warned[topic] = now
                self._node.get_logger().warning(self._explain(topic, found, now - self._heard[topic]))

    def _explain(self, topic: str, found: Sequence[object], silence_s: float) -> str:
        wanted = _type_name(self._kinds[topic])
        if not found:
            others = [name for name, kinds in self._node.get_topic_names_and_types() if wanted in kinds]
            others = sorted(set(others) - {topic})
            there = f"; topics of that type: {', '.join(others)}" if others else ""
            return f"nobody publishes {topic} ({wanted}){there}"
        types = sorted({p.topic_type for p in found})  # type: ignore[attr-defined]
        start = f"{topic} has {len(found)} publisher(s) but nothing came for {silence_s:.0f} s: "
        if types != [wanted]:
            return start + f"it carries {', '.join(types)}, this node takes {wanted}"
        qos = [p.qos_profile for p in found]  # type: ignore[attr-defined]
        durable = any(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in qos)
        return start + (
            "it is published once and kept; a depth topic must stream"
            if durable
            else "the sensor may be paused, or its messages exceed the transport's 8 MiB or cross a network"
        )


def _type_name(kind: type) -> str:
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
