"""Find the only depth topic of a running ROS system."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage, Image

from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.printable import printable
from depth_pose.io import schemas
from depth_pose.io.compressed import depth_encoding
from depth_pose.io.depth_topics import DEPTH_ENCODINGS
from depth_pose.io.messages import read_image, read_message
from depth_pose.ros import stay_local
from depth_pose.ros.process.security import init_context
from depth_pose.ros.transport.depth_sources import DepthSource, depth_sources
from depth_pose.ros.transport.intake import frame_qos

_DISCOVER_S, _SETTLE_S = 10.0, 1.5
"""Time limit for finding a topic, and time for which the list must be stable, seconds."""

_MESSAGE_S = 3.0
"""Time limit for an image, whose encoding shows whether it is depth, seconds."""

_KINDS = {schemas.IMAGE: Image, schemas.COMPRESSED: CompressedImage}


def find_depth(local: bool = False) -> DepthSource:
    """Return the only depth topic: the only image, else compressed image, else cloud.

    Parameters
    ----------
    local : bool
        Stay on this machine (`depth_pose.ros.stay_local`), as the nodes will.

    Raises
    ------
    ConfigError
        Where there is none, or several.
    """
    if local:
        stay_local()
    context = Context()
    init_context(context, args=[])
    try:
        node = rclpy.create_node("find_depth", namespace="depth_pose", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        found = _discover(node, executor)
        images = [source for source in found if source.kind in _KINDS]
        depth = _those_with_depth(node, executor, images)
        executor.shutdown()
        node.destroy_node()
    finally:
        rclpy.try_shutdown(context=context)
    plain = [source for source in depth if source.kind == schemas.IMAGE]
    clouds = [source for source in found if source.kind == schemas.POINT_CLOUD]
    choices = plain or depth or clouds
    if len(choices) == 1:
        return choices[0]
    if not choices:
        seen = f"; images that are not depth: {', '.join(i.topic for i in images)}" if images else ""
        raise ConfigError(f"no depth topic was found in {_DISCOVER_S:.0f} s{printable(seen)}")
    lines = "\n  ".join(printable(choice) for choice in choices)
    raise ConfigError(f"there are {len(choices)} depth topics; give one by its parameters:\n  {lines}")


def _discover(node: Node, executor: SingleThreadedExecutor) -> list[DepthSource]:
    """Return the topics once their list is stable."""
    began = changed = time.monotonic()
    found: list[DepthSource] = []
    while (now := time.monotonic()) - began < _DISCOVER_S:
        executor.spin_once(timeout_sec=0.1)
        before, found = found, depth_sources(node, every=True)
        if found != before:
            changed = now
        if found and now - changed > _SETTLE_S:
            break
    return found


def _those_with_depth(
    node: Node, executor: SingleThreadedExecutor, images: list[DepthSource]
) -> list[DepthSource]:
    """Return the image topics whose first image has an encoding of depth."""
    is_depth: dict[str, bool] = {}

    def take(source: DepthSource, data: Any) -> None:
        try:
            is_depth[source.topic] = _holds_depth(source.kind, data)
        except InputError:
            is_depth[source.topic] = False

    for source in images:
        node.create_subscription(
            _KINDS[source.kind],
            source.topic,
            partial(take, source),
            frame_qos(1, False),
            raw=True,
        )
    began = time.monotonic()
    while len(is_depth) < len(images) and time.monotonic() - began < _MESSAGE_S:
        executor.spin_once(timeout_sec=0.1)
    return [source for source in images if is_depth.get(source.topic)]


def _holds_depth(kind: str, data: bytes) -> bool:
    """Check whether a serialised image, compressed or not, holds depth."""
    if kind == schemas.IMAGE:
        return read_image(data).encoding in DEPTH_ENCODINGS
    image = read_message(data, schemas.COMPRESSED)
    return bool(depth_encoding(image.format, bytes(image.data[:32])))
