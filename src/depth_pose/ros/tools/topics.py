"""List topics and print their messages, for machines without the ``ros2`` command."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from depth_pose.core.errors import InputError
from depth_pose.ros.tools.listener import listener, wait_until
from depth_pose.ros.tools.message_text import message_class

_SETTLED_S = 1.0
"""Seconds without a new topic after which the list is complete; discovery takes 0.1 s with our profile."""

_MOST_VALUES = 8
"""Number of values of a long array that are shown."""

_WAITING = 16
"""Number of messages that may wait to be printed."""


@dataclass(frozen=True)
class TopicState:
    """A topic with its types, and its numbers of publishers and subscribers."""

    name: str
    types: tuple[str, ...]
    publishers: int
    subscribers: int


def list_topics() -> list[TopicState]:
    """Return all topics of the domain, by name; those of this command's own node are left out."""
    with listener("topics") as (node, turns):
        found: dict[str, tuple[str, ...]] = {}
        began = time.monotonic()

        def is_settled() -> bool:
            nonlocal began
            now = {name: tuple(types) for name, types in node.get_topic_names_and_types()}
            if now != found:
                began = time.monotonic()
                found.clear()
                found.update(now)
            return time.monotonic() - began > _SETTLED_S

        wait_until(is_settled, turns)

        def others(publishers: list[Any]) -> int:
            return sum(p.node_name != node.get_name() for p in publishers)

        states = [
            TopicState(
                name, types, others(node.get_publishers_info_by_topic(name)), node.count_subscribers(name)
            )
            for name, types in sorted(found.items())
        ]
    return [state for state in states if state.publishers or state.subscribers]


def echo(topic: str) -> Iterator[dict[str, Any]]:
    """Yield the messages of a topic as plain values until SIGINT or SIGTERM.

    Subscribes with the reliability and durability of the topic's publishers, so a latched message is shown.

    Raises
    ------
    InputError
        If nobody publishes the topic, or its type is not installed here.
    """
    waiting: deque[Any] = deque(maxlen=_WAITING)
    with listener("echo") as (node, turns):
        if not wait_until(lambda: bool(node.get_publishers_info_by_topic(topic)), turns):
            there = [name for name, _ in node.get_topic_names_and_types() if node.count_publishers(name)]
            raise InputError(f"nobody publishes {topic}; there are {', '.join(sorted(there))}")
        publishers = node.get_publishers_info_by_topic(topic)
        kind = message_class(publishers[0].topic_type)
        reliable = all(p.qos_profile.reliability == ReliabilityPolicy.RELIABLE for p in publishers)
        latched = all(p.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in publishers)
        qos = QoSProfile(
            depth=_WAITING,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        node.create_subscription(kind, topic, lambda message: waiting.append(message), qos)
        for _ in turns(0.0):
            while waiting:
                yield plain_values(waiting.popleft())
            next(turns(0.05), None)


def plain_values(value: Any) -> Any:
    """Return a message as dictionaries, lists and plain values; long arrays are cut, with their length."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain_values(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, bytes) and len(value) == 1:  # the type byte
        return value[0]
    if isinstance(value, str) or not hasattr(value, "__len__"):
        return value
    is_nested = len(value) > 0 and hasattr(value[0], "get_fields_and_field_types")
    most = len(value) if is_nested else _MOST_VALUES
    shown = [plain_values(v) for v in value[:most]]
    return shown if len(value) <= most else [*shown, f"... {len(value)} values"]
