"""Reading recordings: depth frames from any camera, and skeletons.

Topics are found by what they hold, not by their names: images of a depth encoding with a
CameraInfo beside them, or point clouds.
"""

from __future__ import annotations

import logging
import re
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from depth_pose.core.errors import InputError
from depth_pose.core.types import DepthFrame, Skeleton
from depth_pose.io import schemas
from depth_pose.io._messages import SkeletonsMessage, read_image, read_message, read_skeleton, stamp_of
from depth_pose.io._messages import read_people as read_people_message
from depth_pose.io._recording import RawMessage, Recording, Topic
from depth_pose.io.compressed import TOPIC_ENDING, decode_compressed_depth
from depth_pose.io.damage import tell_damage
from depth_pose.io.decode import (
    camera_from_info,
    decode_depth,
    decode_points,
    frame_from_cloud,
    rectify_depth,
)
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.schemas import PEOPLE_TOPIC, SKELETON_TOPIC

_log = logging.getLogger(__name__)
_DEPTH_ENCODINGS = ("16UC1", "mono16", "32FC1")
_OWN_TOPICS = "/depth_pose/"
_MOST_TOPICS = 20
"""Topics that an error lists. Set by hand."""
_ZSTD = b"\x28\xb5\x2f\xfd"
_REALSENSE = re.compile(r"(/device_\d+/sensor_\d+)/Depth_\d+/image/data")
"""Where librealsense puts depth images; their unit is an option of their sensor."""


@dataclass(frozen=True)
class DepthTopic:
    """A topic that depth frames can be made from.

    Attributes
    ----------
    name : str
    kind : str
        ``sensor_msgs/msg/Image``, ``CompressedImage`` or ``PointCloud2``.
    info_topic : str
        The CameraInfo topic that belongs to it; empty for a cloud.
    frames : int
        How many messages the recording has; for one cut short, how many are readable.
    """

    name: str
    kind: str
    info_topic: str
    frames: int


def find_depth_topics(path: Path | str) -> tuple[DepthTopic, ...]:
    """List the topics of a recording that depth frames can be made from.

    Raises
    ------
    InputError
        Where the file is missing or no MCAP recording.
    """
    return _depth_topics(Recording(path))


def _depth_topics(recording: Recording) -> tuple[DepthTopic, ...]:
    found = []
    for topic in recording.topics.values():
        if topic.count == 0:
            continue
        is_image = topic.kind == schemas.IMAGE and _is_depth_image(recording, topic.name)
        is_compressed = topic.kind == schemas.COMPRESSED and topic.name.endswith(TOPIC_ENDING)
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
        return read_image(message.data).encoding in _DEPTH_ENCODINGS
    except InputError:
        return False


def _info_topic(recording: Recording, image_topic: str) -> str:
    """Name the CameraInfo topic beside an image topic, or in the nearest namespace above; else ''."""
    infos = [t.name for t in recording.topics.values() if t.kind == schemas.CAMERA_INFO and t.count > 0]
    namespace = image_topic
    while namespace:
        if f"{namespace}/camera_info" in infos:
            return f"{namespace}/camera_info"
        if f"{namespace}/info/camera_info" in infos:  # as librealsense records
            return f"{namespace}/info/camera_info"
        inside = [name for name in infos if name.rpartition("/")[0] == namespace]
        if len(inside) == 1:
            return inside[0]
        namespace = namespace.rpartition("/")[0]
    return infos[0] if len(infos) == 1 else ""


def _choose(recording: Recording, wanted: str | None) -> DepthTopic:
    """Pick the depth topic: the one wanted, else the only image, else the only cloud."""
    if wanted is not None:
        return _named_topic(recording, wanted)
    topics = _depth_topics(recording)
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
    raise InputError(f"{recording.path} has no depth image or point cloud; {_listing(recording)}")


def _named_topic(recording: Recording, name: str) -> DepthTopic:
    topic = recording.topics.get(name) or recording.topics.get("/" + name)
    if topic is None and name in recording.others:
        raise InputError(f"{recording.path}: {name} cannot be read: {recording.others[name]}")
    if topic is None or topic.count == 0:
        choices = ", ".join(t.name for t in _depth_topics(recording)) or "none"
        raise InputError(f"{recording.path} has no messages on {name}; its depth topics are: {choices}")
    if topic.kind == schemas.POINT_CLOUD:
        return DepthTopic(topic.name, topic.kind, "", topic.count)
    if topic.kind not in (schemas.IMAGE, schemas.COMPRESSED):
        raise InputError(f"{recording.path}: {name} is a {topic.kind}; depth is an Image or PointCloud2")
    info = _info_topic(recording, topic.name)
    return _with_info(recording, DepthTopic(topic.name, topic.kind, info, topic.count))


def _with_info(recording: Recording, topic: DepthTopic) -> DepthTopic:
    if topic.kind != schemas.POINT_CLOUD and not topic.info_topic:
        beside = topic.name.rpartition("/")[0] + "/camera_info"
        raise InputError(
            f"{recording.path}: {topic.name} has no CameraInfo; record {beside} with it "
            f"({_listing(recording)})"
        )
    return topic


def _listing(recording: Recording) -> str:
    """Say what topics there are, and why each is no depth."""
    topics = {t.name: _what_it_is(recording, t) for t in recording.topics.values()} | recording.others
    lines = [f"{name} ({what})" for name, what in sorted(topics.items())]
    if len(lines) > _MOST_TOPICS:
        lines[_MOST_TOPICS:] = [f"and {len(lines) - _MOST_TOPICS} more"]
    listing = "it has " + (", ".join(lines) if lines else "no topics")
    return "; ".join([listing, *recording.damage])


def _what_it_is(recording: Recording, topic: Topic) -> str:
    """Say what a topic holds, and of images why they are no depth."""
    kind = topic.kind
    if topic.count == 0:
        return f"{kind} without messages"
    if kind == schemas.COMPRESSED and not topic.name.endswith(TOPIC_ENDING):
        return f"{kind}, which holds colours; depth is on topics that end in {TOPIC_ENDING}"
    if kind != schemas.IMAGE:
        return kind
    message = recording.first(topic.name)
    if message is None:
        return f"{kind} that cannot be read"
    if message.data.startswith(_ZSTD):
        return f"{kind}, each packed by itself; give the folder with the metadata.yaml that says so"
    try:
        encoding = read_image(message.data).encoding
    except InputError:
        return f"{kind} that cannot be read"
    return kind if encoding in _DEPTH_ENCODINGS else f"{kind} of {encoding[:20]}, which is no depth"


class DepthReader:
    """The depth frames of a recording, in order; may be iterated again.

    Parameters
    ----------
    path : Path or str
        A recording: MCAP, .db3, ROS 1's .bag, a folder of these, or a folder of depth images.
    depth_topic : str, optional
        The topic; by default the only one there is.
    images : ImageOptions, optional
        What a folder of images does not say: its camera, depth unit, frame rate.
    tell : bool
        Tell damage on `depth_pose.io.damage.DAMAGE_LOG` at the end; `damage` has it in any case.

    Attributes
    ----------
    topic : DepthTopic
        What is read.

    Raises
    ------
    InputError
        Where the recording cannot be read, or it is not clear which topic is meant, or (on
        iteration) not one of its frames can be used.
    """

    def __init__(
        self,
        path: Path | str,
        depth_topic: str | None = None,
        images: ImageOptions | None = None,
        tell: bool = True,
    ) -> None:
        self._recording = Recording(path, images)
        self._tell = tell
        self.topic = _choose(self._recording, depth_topic)
        self._unit_mm = _realsense_unit_mm(self._recording, self.topic.name)
        self._dropped: Counter[str] = Counter()

    def __len__(self) -> int:
        """Give the number of frames that the recording is said to have."""
        return self.topic.frames

    @property
    def path(self) -> Path:
        """The recording's file or folder."""
        return self._recording.path

    @property
    def dropped(self) -> int:
        """Number of frames, since iteration began, that could not be used."""
        return self._dropped.total()

    @property
    def damage(self) -> list[str]:
        """What of the recording cannot be read, as far as reading has come, one line a file."""
        return self._recording.damage

    @property
    def warnings(self) -> list[str]:
        """What went wrong since iteration began, one line each with its count."""
        lines = self.damage
        for reason, count in self._dropped.items():
            frames = "1 frame was" if count == 1 else f"{count} frames were"
            lines.append(f"{frames} dropped: {self._recording.path}: {self.topic.name}: {reason}")
        return lines

    def __iter__(self) -> Iterator[DepthFrame]:
        self._dropped.clear()
        info = self._first_info()
        used = 0
        for message in self._recording.messages(*filter(None, (self.topic.name, self.topic.info_topic))):
            if message.topic == self.topic.info_topic:
                info = message
                continue
            try:
                frame = self._frame(message, info)
            except InputError as error:
                self._dropped[str(error)] += 1
                continue
            used += 1
            yield frame
        if self._tell and used:
            tell_damage(self.damage)
        if not used:
            raise InputError("; ".join(self.warnings) or f"{self._recording.path} has no frames")

    def _first_info(self) -> RawMessage | None:
        """Give the first calibration, which may be recorded after the first image."""
        return self._recording.first(self.topic.info_topic) if self.topic.info_topic else None

    def _frame(self, message: RawMessage, info: RawMessage | None) -> DepthFrame:
        if self.topic.kind == schemas.POINT_CLOUD:
            return frame_of_cloud(message.data)
        if info is None:
            raise InputError(f"no CameraInfo on {self.topic.info_topic}")
        frame = frame_of_image(message.data, self.topic.kind, info.data)
        if self._unit_mm != 1.0:
            frame = replace(frame, depth=frame.depth * np.float32(self._unit_mm))
        return frame


def _realsense_unit_mm(recording: Recording, topic: str) -> float:
    """Give the unit of librealsense's depth images, millimetres; 1 for all others."""
    found = _REALSENSE.fullmatch(topic)
    unit = recording.first(f"{found[1]}/option/Depth_Units/value") if found else None
    if unit is None or len(unit.data) != 8:
        return 1.0
    (metres,) = struct.unpack("<f", unit.data[4:])  # std_msgs/Float32
    mm = round(float(metres) * 1e3, 6)
    return mm if 1e-3 <= mm <= 1e3 else 1.0


def frame_of_image(data: bytes, kind: str, info_data: bytes) -> DepthFrame:
    """Make a frame of an Image's or CompressedImage's CDR bytes and its camera's calibration."""
    image, info = read_message(data, kind), read_message(info_data, schemas.CAMERA_INFO)
    if kind == schemas.COMPRESSED:
        depth = decode_compressed_depth(image.format, image.data)
    else:
        size = (image.height, image.width, image.step, image.encoding)
        depth = decode_depth(image.data, *size, image.is_bigendian)
    camera = camera_from_info(info.k, info.d, info.width, info.height, info.distortion_model)
    depth = rectify_depth(depth, camera, info.d, info.distortion_model)
    return DepthFrame(stamp_of(image), image.header.frame_id, depth, camera)


def frame_of_cloud(data: bytes) -> DepthFrame:
    """Make a frame of a PointCloud2's CDR bytes."""
    cloud = read_message(data, schemas.POINT_CLOUD)
    fields = {field.name: (field.offset, field.datatype) for field in cloud.fields}
    steps = (cloud.point_step, cloud.row_step)
    points = decode_points(cloud.data, cloud.height, cloud.width, *steps, fields, cloud.is_bigendian)
    return frame_from_cloud(points, stamp_of(cloud), cloud.header.frame_id)


def read_frames(
    path: Path | str, depth_topic: str | None = None, images: ImageOptions | None = None
) -> Iterator[DepthFrame]:
    """Give the depth frames of a recording, in order; what was dropped is logged at the end.

    Parameters
    ----------
    path, depth_topic, images
        As of `DepthReader`.

    Raises
    ------
    InputError
        As `DepthReader`; at the call where the recording or its topics are at fault.
    """
    return _logged(DepthReader(path, depth_topic, images))


def _logged(reader: DepthReader) -> Iterator[DepthFrame]:
    yield from reader
    for line in reader.warnings:
        if line not in reader.damage:
            _log.warning("%s", line)


def read_skeletons(path: Path | str, topic: str = SKELETON_TOPIC) -> Iterator[Skeleton]:
    """Give the skeletons of a recording, in order.

    Parameters
    ----------
    path : Path or str
        An MCAP file, or a folder of them.
    topic : str
        The topic's name.

    Raises
    ------
    InputError
        Where the recording has no such topic.
    """
    recording = Recording(path)
    _require(recording, topic, schemas.SKELETON)
    definition = recording.topics[topic].definition or schemas.BUILD_LINE
    return (read_skeleton(data, definition) for data in _data_of(recording, topic))


def read_people(path: Path | str, topic: str = PEOPLE_TOPIC) -> Iterator[SkeletonsMessage]:
    """Give everybody's skeletons, frame by frame, in order.

    A recording without such a topic that has `SKELETON_TOPIC` gives the one person there.

    Parameters
    ----------
    path : Path or str
        An MCAP file, or a folder of them.
    topic : str
        The topic's name.

    Raises
    ------
    InputError
        Where the recording has neither topic.
    """
    recording = Recording(path)
    found = recording.topics.get(topic)
    if found is not None and found.kind == schemas.SKELETON:
        text = found.definition or schemas.BUILD_LINE
        return (_alone(read_skeleton(data, text)) for data in _data_of(recording, topic))
    if topic == PEOPLE_TOPIC and found is None and SKELETON_TOPIC in recording.topics:
        return read_people(path, SKELETON_TOPIC)
    _require(recording, topic, schemas.SKELETON_ARRAY)
    definition = recording.topics[topic].definition or schemas.BUILD_LINE
    return (read_people_message(data, definition) for data in _data_of(recording, topic))


def _alone(skeleton: Skeleton) -> SkeletonsMessage:
    shown = () if skeleton.is_lost else (skeleton,)
    return SkeletonsMessage(skeleton.stamp_ns, skeleton.frame_id, shown)


def _require(recording: Recording, topic: str, kind: str) -> None:
    found = recording.topics.get(topic)
    if found is None or found.kind != kind:
        others = [t.name for t in recording.topics.values() if t.kind == kind]
        raise InputError(
            f"{recording.path} has no skeletons on {topic}"
            + (f"; it has {', '.join(others)}" if others else f"; {_listing(recording)}")
        )


def _data_of(recording: Recording, topic: str) -> Iterator[bytes]:
    for message in recording.messages(topic):
        yield message.data
    tell_damage(recording.damage)
