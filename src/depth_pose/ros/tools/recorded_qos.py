"""QoS of publishers, as rosbag2 writes it into recordings (``offered_qos_profiles``), and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from depth_pose.core.errors import ConfigError
from depth_pose.core.reading import parse_yaml

_LATCHED = ("/tf_static", "/robot_description")
"""Topics that are latched, even if a recording does not say so (REP 105, urdf)."""

_MOST_TEXT = 1 << 16
"""Maximum number of characters of profiles; a profile has 400."""


def qos_text(offers: Sequence[Any]) -> str:
    """Write publishers' QoS profiles as rosbag2 of Jazzy does, YAML."""
    return "\n".join(_profile_text(offer) for offer in offers)


def _profile_text(qos: Any) -> str:
    lines = [
        f"history: {qos.history.name.lower()}",
        f"depth: {qos.depth}",
        f"reliability: {qos.reliability.name.lower()}",
        f"durability: {qos.durability.name.lower()}",
        f"deadline: {_duration_text(qos.deadline)}",
        f"lifespan: {_duration_text(qos.lifespan)}",
        f"liveliness: {qos.liveliness.name.lower()}",
        f"liveliness_lease_duration: {_duration_text(qos.liveliness_lease_duration)}",
        f"avoid_ros_namespace_conventions: {str(qos.avoid_ros_namespace_conventions).lower()}",
    ]
    return "- " + "\n  ".join(lines)


def _duration_text(duration: Any) -> str:
    seconds, rest = divmod(duration.nanoseconds, 1_000_000_000)
    return f"{{sec: {seconds}, nsec: {rest}}}"


def is_latched(topic: str, text: str) -> bool:
    """Whether a topic's messages were latched for later subscribers (transient local)."""
    try:
        profiles = parse_yaml(topic, text[:_MOST_TEXT])
    except ConfigError:
        profiles = None
    if not isinstance(profiles, list) or not profiles:
        return topic in _LATCHED
    offered = [p.get("durability") for p in profiles if isinstance(p, dict)]
    return bool(offered) and all(str(d).lower() in ("1", "transient_local") for d in offered)
