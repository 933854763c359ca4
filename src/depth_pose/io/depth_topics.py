"""Topics of a recording that provide depth frames.

They are found by content, not by name: images of a depth encoding with a matching CameraInfo, or point
clouds.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from depth_pose.core.errors import InputError
from depth_pose.io import schemas
from depth_pose.io.compressed import TOPIC_ENDING, depth_encoding
from depth_pose.io.messages import read_image, read_message
from depth_pose.io.recording import Recording, Topic

DEPTH_ENCODINGS = ("16UC1", "mono16", "32FC1")
"""Encodings of images that hold depth."""

_OWN_TOPICS = "/depth_pose/"
_MOST_TOPICS = 20
"""Maximum number of topics listed in an error."""
_ZSTD = b"\x28\xb5\x2f\xfd"
_REALSENSE_TEXT = re.compile(r"/device_\d+/sensor_\d+/Depth_\d+/(info/)?camera_info")
"""CameraInfo topics of RealSense's SDK, which some of its versions write as text."""


@dataclass(frozen=True)
class DepthTopic:
    """A topic that provides depth frames.

    Attributes
    ----------
    name : str
    kind : str
        ``sensor_msgs/msg/Image``, ``CompressedImage`` or ``PointCloud2``.
    info_topic : str
        The matching CameraInfo topic; empty for a cloud.
    frames : int
        Number of messages; of a truncated recording, the number of readable ones.
    """

    name: str
    kind: str
    info_topic: str
    frames: int


def depth_topics(recording: Recording) -> tuple[DepthTopic, ...]:
    """List the topics of an open recording that provide depth frames."""
    found = []
    for topic in recording.topics.values():
        if topic.count == 0:
            continue
        is_image = topic.kind == schemas.IMAGE and _is_depth_image(recording, topic.name)
        is_compressed = topic.kind == schemas.COMPRESSED and _is_compressed_depth(recording, topic.name)
        if is_image or is_compressed:
            info = _info_topic(recording, topic.name)
            found.append(DepthTopic(topic.name, topic.kind, info, topic.count))
        elif topic.kind == schemas.POINT_CLOUD and not topic.name.startswith(_OWN_TOPICS):
            found.append(DepthTopic(topic.name, topic.kind, "", topic.count))
    return tuple(sorted(found, key=lambda topic: topic.name))


def _is_depth_image(recording: Recording, topic: str) -> bool:
    message = recording.first(topic)
    if message is None:
        return False
    try:
        return read_image(message.data).encoding in DEPTH_ENCODINGS
    except InputError:
        return False


def _is_compressed_depth(recording: Recording, topic: str) -> bool:
    message = recording.first(topic)
    if message is None:
        return False
    try:
        image = read_message(message.data, schemas.COMPRESSED)
    except InputError:
        return topic.endswith(TOPIC_ENDING)
    return bool(depth_encoding(image.format, bytes(image.data[:32]))) or topic.endswith(TOPIC_ENDING)


def _info_topic(recording: Recording, image_topic: str) -> str:
    """Return the CameraInfo topic for an image topic; else ''."""
    infos = [t.name for t in recording.topics.values() if t.kind == schemas.CAMERA_INFO and t.count > 0]
    return info_beside(image_topic, infos)


def info_beside(image_topic: str, infos: Sequence[str]) -> str:
    """Name the CameraInfo topic beside an image topic, or in the nearest namespace above; else ''."""
    namespace = image_topic
    while namespace:
        if f"{namespace}/camera_info" in infos:
            return f"{namespace}/camera_info"
        if f"{namespace}/info/camera_info" in infos:  # as recorded by librealsense
            return f"{namespace}/info/camera_info"
        inside = [name for name in infos if name.rpartition("/")[0] == namespace]
        if len(inside) == 1:
            return inside[0]
        namespace = namespace.rpartition("/")[0]
    return infos[0] if len(infos) == 1 else ""


def choose_depth_topic(recording: Recording, wanted: str | None) -> DepthTopic:
    """Choose the depth topic: the requested one, else the only image, else the only cloud."""
    if wanted is not None:
        return _named_topic(recording, wanted)
    topics = depth_topics(recording)
    images = [t for t in topics if t.kind == schemas.IMAGE]
    images = images or [t for t in topics if t.kind == schemas.COMPRESSED]
    named = [t for t in images if "depth" in t.name.lower()]
    for choice in (images, named, list(topics) if not images else []):
        if len(choice) == 1:
            return _with_info(recording, choice[0])
    if topics:
        names = ", ".join(t.name for t in topics)
        raise InputError(
            f"{recording.path} has {len(topics)} depth topics: {names}; choose one with --depth-topic TOPIC"
        )
    _refuse_realsense_text(recording)
    raise InputError(f"{recording.path} has no depth image or point cloud; {describe_topics(recording)}")


def _named_topic(recording: Recording, name: str) -> DepthTopic:
    topic = recording.topics.get(name) or recording.topics.get("/" + name)
    if topic is None and name in recording.others:
        raise InputError(f"{recording.path}: {name} cannot be read: {recording.others[name]}")
    if topic is None or topic.count == 0:
        choices = ", ".join(t.name for t in depth_topics(recording)) or "none"
        raise InputError(f"{recording.path} has no messages on {name}; its depth topics are: {choices}")
    if topic.kind == schemas.POINT_CLOUD:
        return DepthTopic(topic.name, topic.kind, "", topic.count)
    if topic.kind not in (schemas.IMAGE, schemas.COMPRESSED):
        raise InputError(f"{recording.path}: {name} is a {topic.kind}; depth is an Image or PointCloud2")
    info = _info_topic(recording, topic.name)
    return _with_info(recording, DepthTopic(topic.name, topic.kind, info, topic.count))


def _with_info(recording: Recording, topic: DepthTopic) -> DepthTopic:
    if topic.kind != schemas.POINT_CLOUD and not topic.info_topic:
        _refuse_realsense_text(recording)
        beside = topic.name.rpartition("/")[0] + "/camera_info"
        raise InputError(
            f"{recording.path}: {topic.name} has no CameraInfo; record {beside} with it "
            f"({describe_topics(recording)})"
        )
    return topic


def _refuse_realsense_text(recording: Recording) -> None:
    """Raise InputError where RealSense's SDK wrote a calibration as text: its format is not documented."""
    for topic in recording.topics.values():
        if _REALSENSE_TEXT.fullmatch(topic.name) and topic.kind != schemas.CAMERA_INFO:
            raise InputError(
                f"{recording.path}: {topic.name} is a {topic.kind}, as the RealSense SDK writes some .db3 "
                f"files, and not a {schemas.CAMERA_INFO}: record the topics of the ROS driver "
                "realsense2_camera with `ros2 bag record`, or with the SDK to a .bag file"
            )


def describe_topics(recording: Recording) -> str:
    """Describe the topics of a recording, and why each does not provide depth."""
    topics = {t.name: _what_it_is(recording, t) for t in recording.topics.values()} | recording.others
    lines = [f"{name} ({what})" for name, what in sorted(topics.items())]
    if len(lines) > _MOST_TOPICS:
        lines[_MOST_TOPICS:] = [f"and {len(lines) - _MOST_TOPICS} more"]
    listing = "it has " + (", ".join(lines) if lines else "no topics")
    return "; ".join([listing, *recording.damage])


def _what_it_is(recording: Recording, topic: Topic) -> str:
    """Describe the content of a topic, and for images why it is not depth."""
    kind = topic.kind
    if topic.count == 0:
        return f"{kind} without messages"
    if kind == schemas.COMPRESSED and not _is_compressed_depth(recording, topic.name):
        return f"{kind}, which holds colour images; depth is mostly on topics that end in {TOPIC_ENDING}"
    if kind != schemas.IMAGE:
        return kind
    message = recording.first(topic.name)
    if message is None:
        return f"{kind} that cannot be read"
    if message.data.startswith(_ZSTD):
        return f"{kind}, individually compressed; give the folder with its metadata.yaml"
    try:
        encoding = read_image(message.data).encoding
    except InputError:
        return f"{kind} that cannot be read"
    return kind if encoding in DEPTH_ENCODINGS else f"{kind} of {encoding[:20]}, which is not depth"
