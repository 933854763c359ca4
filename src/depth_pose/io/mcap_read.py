"""Reading of depth frames from recordings of any camera; skeletons are in `depth_pose.io.skeleton_read`."""

from __future__ import annotations

import logging
import re
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from depth_pose.core.errors import InputError
from depth_pose.core.types import DepthFrame
from depth_pose.io import schemas
from depth_pose.io._messages import read_message, stamp_of
from depth_pose.io._recording import RawMessage, Recording
from depth_pose.io.calibration import camera_from_info, is_rectified, lens_of, rectify_depth
from depth_pose.io.clouds import decode_points, frame_from_cloud
from depth_pose.io.compressed import decode_compressed_depth
from depth_pose.io.damage import tell_damage
from depth_pose.io.decode import decode_depth
from depth_pose.io.depth_topics import choose_depth_topic
from depth_pose.io.image_options import ImageOptions

_log = logging.getLogger(__name__)
_REALSENSE = re.compile(r"(/device_\d+/sensor_\d+)/Depth_\d+/image/data")
"""Depth image topics of librealsense; their unit is an option of the sensor."""


class DepthReader:
    """The depth frames of a recording, in order; may be iterated again.

    Parameters
    ----------
    path : Path or str
        A recording: MCAP, .db3, ROS 1's .bag, a folder of these, or a folder of depth images.
    depth_topic : str, optional
        The topic; by default the only one.
    images : ImageOptions, optional
        Camera, depth unit and frame rate of a folder of images.
    tell : bool
        Log damage on `depth_pose.io.damage.DAMAGE_LOG` at the end; `damage` returns it in any case.

    Attributes
    ----------
    topic : DepthTopic
        The topic that is read.

    Raises
    ------
    InputError
        If the recording cannot be read, the topic is ambiguous, or (on iteration)
        none of its frames can be used.
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
        self.topic = choose_depth_topic(self._recording, depth_topic)
        self._unit_mm = _realsense_unit_mm(self._recording, self.topic.name)
        self._dropped: Counter[str] = Counter()

    def __len__(self) -> int:
        """Return the expected number of frames."""
        return self.topic.frames

    @property
    def path(self) -> Path:
        """The recording's file or folder."""
        return self._recording.path

    @property
    def dropped(self) -> int:
        """Number of unusable frames since iteration began."""
        return self._dropped.total()

    @property
    def damage(self) -> list[str]:
        """Return the damage found so far, one line per file."""
        return self._recording.damage

    @property
    def warnings(self) -> list[str]:
        """Return the problems since iteration began, one line each with its count."""
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
        """Return the first calibration, which may be recorded after the first image."""
        return self._recording.first(self.topic.info_topic) if self.topic.info_topic else None

    def _frame(self, message: RawMessage, info: RawMessage | None) -> DepthFrame:
        if self.topic.kind == schemas.POINT_CLOUD:
            return frame_of_cloud(message.data)
        if info is None:
            raise InputError(f"no CameraInfo on {self.topic.info_topic}")
        frame = frame_of_image(message.data, self.topic.kind, info.data, is_rectified(self.topic.name))
        if self._unit_mm != 1.0:
            frame = replace(frame, depth=frame.depth * np.float32(self._unit_mm))
        return frame


def _realsense_unit_mm(recording: Recording, topic: str) -> float:
    """Return the unit of librealsense's depth images, millimetres; 1 for all others."""
    found = _REALSENSE.fullmatch(topic)
    unit = recording.first(f"{found[1]}/option/Depth_Units/value") if found else None
    if unit is None or len(unit.data) != 8:
        return 1.0
    (metres,) = struct.unpack("<f", unit.data[4:])  # std_msgs/Float32
    mm = round(float(metres) * 1e3, 6)
    return mm if 1e-3 <= mm <= 1e3 else 1.0


def frame_of_image(data: bytes, kind: str, info_data: bytes, rectified: bool = False) -> DepthFrame:
    """Build a frame from an Image's or CompressedImage's CDR bytes and its camera's calibration.

    A rectified image (`depth_pose.io.calibration.is_rectified`) is used unchanged.
    """
    image, info = read_message(data, kind), read_message(info_data, schemas.CAMERA_INFO)
    if kind == schemas.COMPRESSED:
        depth = decode_compressed_depth(image.format, image.data)
    else:
        size = (image.height, image.width, image.step, image.encoding)
        depth = decode_depth(image.data, *size, image.is_bigendian)
    k, d = lens_of(info.k, info.d, info.p, rectified)
    camera = camera_from_info(k, d, info.width, info.height, info.distortion_model)
    depth = rectify_depth(depth, camera, d, info.distortion_model)
    return DepthFrame(stamp_of(image), image.header.frame_id, depth, camera)


def frame_of_cloud(data: bytes) -> DepthFrame:
    """Build a frame from a PointCloud2's CDR bytes."""
    cloud = read_message(data, schemas.POINT_CLOUD)
    fields = {field.name: (field.offset, field.datatype) for field in cloud.fields}
    steps = (cloud.point_step, cloud.row_step)
    points = decode_points(cloud.data, cloud.height, cloud.width, *steps, fields, cloud.is_bigendian)
    return frame_from_cloud(points, stamp_of(cloud), cloud.header.frame_id)


def read_frames(
    path: Path | str, depth_topic: str | None = None, images: ImageOptions | None = None
) -> Iterator[DepthFrame]:
    """Yield the depth frames of a recording, in order; dropped frames are logged at the end.

    Parameters
    ----------
    path, depth_topic, images
        As of `DepthReader`.

    Raises
    ------
    InputError
        As `DepthReader`; raised at the call for faults of the recording or its topics.
    """
    return _logged(DepthReader(path, depth_topic, images))


def _logged(reader: DepthReader) -> Iterator[DepthFrame]:
    yield from reader
    for line in reader.warnings:
        if line not in reader.damage:
            _log.warning("%s", line)
