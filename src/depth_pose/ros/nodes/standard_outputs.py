"""People as messages of other packages: ``vision_msgs/Detection3DArray`` and ``people_msgs/People``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import Point, Vector3

from depth_pose.core.errors import ConfigError
from depth_pose.core.result import Skeleton
from depth_pose.ros.messages.basics import make_header

if TYPE_CHECKING:
    from depth_pose.ros.nodes.node_base import StageNode

QUEUE = 10
"""Queue length for a slow subscriber."""


class StandardOutputs:
    """Publishes what the parameters ``vision_msgs`` and ``people_msgs`` ask for.

    Parameters
    ----------
    node : StageNode
    detections : str
        Topic of the detections.

    Raises
    ------
    ConfigError
        If the package of a message is not installed.
    """

    def __init__(self, node: StageNode, detections: str) -> None:
        self._detections = self._people = None
        if node.value("vision_msgs"):
            self._vision = _messages("vision_msgs")
            self._detections = node.publisher(
                self._vision.Detection3DArray, detections, reliable=True, counted=False
            )
        if node.value("people_msgs"):
            self._social = _messages("people_msgs")
            self._people = node.open_publisher(self._social.People, "/people", QUEUE)

    def publish(self, skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> None:
        """Publish one frame to those who listen."""
        if self._detections is not None and self._detections.get_subscription_count():
            header = make_header(stamp_ns, frame_id)
            found = [_detection(self._vision, skeleton, header) for skeleton in skeletons]
            self._detections.publish(self._vision.Detection3DArray(header=header, detections=found))
        if self._people is not None and self._people.get_subscription_count():
            people = [_person(self._social, skeleton) for skeleton in skeletons]
            self._people.publish(self._social.People(header=make_header(stamp_ns, frame_id), people=people))


def _detection(vision: Any, skeleton: Skeleton, header: Any) -> Any:
    """Return a person's box; its pose has no rotation."""
    low, high = skeleton.box
    detection = vision.Detection3D(header=header, id=skeleton.body_id)
    _set(detection.bbox.center.position, 0.5 * (low + high))
    _set(detection.bbox.size, high - low)
    result = vision.ObjectHypothesisWithPose()
    result.hypothesis.class_id, result.hypothesis.score = "person", float(skeleton.confidence)
    result.pose.pose = detection.bbox.center
    detection.results = [result]
    return detection


def _person(social: Any, skeleton: Skeleton) -> Any:
    """Return a person's centre, and velocity; 0 while it is unknown."""
    person = social.Person(name=skeleton.body_id, reliability=float(skeleton.confidence))
    _set(person.position, skeleton.centre)
    _set(person.velocity, np.nan_to_num(skeleton.velocity))
    return person


def _set(target: Point | Vector3, values: np.ndarray) -> None:
    target.x, target.y, target.z = values.tolist()


def _messages(package: str) -> Any:
    """Import a package's messages."""
    try:
        if package == "vision_msgs":
            from vision_msgs import msg
        else:
            from people_msgs import msg
    except ImportError as error:
        raise ConfigError(
            f"the parameter {package} needs the package {package}, which is not installed; with ROS from apt "
            f"install ros-jazzy-{package.replace('_', '-')}"
        ) from error
    return msg
