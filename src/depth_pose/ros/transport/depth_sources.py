"""The depth topics of a running ROS system, and the node parameters for each."""

from __future__ import annotations

from dataclasses import dataclass

from rclpy.node import Node

from depth_pose.io import schemas
from depth_pose.io.depth_topics import info_beside
from depth_pose.ros import NODES


@dataclass(frozen=True)
class DepthSource:
    """A topic that may carry depth.

    Attributes
    ----------
    topic, kind : str
        Its name and message type.
    parameters : dict of str to str
        Parameters of the nodes that select it.
    """

    topic: str
    kind: str
    parameters: dict[str, str]

    def __str__(self) -> str:
        given = " ".join(f"{name}:={value}" for name, value in self.parameters.items())
        return f"{self.topic} ({self.kind}): {given}"


def depth_sources(node: Node, *, every: bool = False) -> list[DepthSource]:
    """List the topics, other than the suite's, that may carry depth: images, compressed images, clouds.

    If some image topics are named ``depth``, only those are listed, and of compressed images no others, which
    mostly are colour, unless ``every`` image is wanted. Images without a CameraInfo are left out, and so are
    topics of a suite's nodes in any namespace.
    """
    topics = {name: kinds for name, kinds in node.get_topic_names_and_types() if _has_foreign(node, name)}
    infos = [name for name, kinds in topics.items() if schemas.CAMERA_INFO in kinds]
    images, clouds = [], []
    for name, kinds in sorted(topics.items()):
        for kind in kinds:
            if kind == schemas.POINT_CLOUD:
                clouds.append(DepthSource(name, kind, {"cloud_topic": name}))
            elif kind in (schemas.IMAGE, schemas.COMPRESSED) and (info := info_beside(name, infos)):
                images.append(DepthSource(name, kind, {"image_topic": name, "info_topic": info}))
    if every:
        return images + clouds
    named = [image for image in images if "depth" in image.topic.lower()]
    return (named or [image for image in images if image.kind == schemas.IMAGE]) + clouds


def _has_foreign(node: Node, topic: str) -> bool:
    """Whether a topic has a publisher outside a suite."""
    found = node.get_publishers_info_by_topic(topic)
    return any(publisher.node_name not in NODES for publisher in found)
