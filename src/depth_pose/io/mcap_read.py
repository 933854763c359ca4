"""Reading of depth frames from recordings of any camera; skeletons are in `depth_pose.io.skeleton_read`."""

from __future__ import annotations

import logging
import re
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.io import schemas
from depth_pose.io.calibration import is_rectified, lens_of_image
from depth_pose.io.camera_infos import CameraInfos
from depth_pose.io.clouds import BODY_AXES, OPTICAL, decode_points, frame_from_cloud
from depth_pose.io.compressed import decode_compressed_depth
from depth_pose.io.damage import tell_damage
from depth_pose.io.decode import WRONG_ORDER, decode_depth, is_order_wrong
from depth_pose.io.depth_topics import choose_depth_topic
from depth_pose.io.depth_unit import INTEGER_UNIT_M, UnitWatch, unit_of
from depth_pose.io.frame_order import FrameOrder
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.messages import read_message, stamp_of
from depth_pose.io.recording import RawMessage, Recording
from depth_pose.io.rectification import rectify_depth

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
        Camera, depth unit and frame rate of a folder of images. The depth unit applies to any recording.
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
        self._unit_m = self._recording.unit_m or _realsense_unit_m(self._recording, self.topic.name)
        self._is_unit_given = images is not None and images.depth_scale is not None
        self._forget()

    def _forget(self) -> None:
        self._units = UnitWatch("--depth-scale")
        self._infos = CameraInfos(self.topic.info_topic)
        self._looked_for: set[str] = set()
        self._dropped: Counter[str] = Counter()
        self._order = FrameOrder()
        self._notes: list[str] = []

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
        return self._dropped.total() + self._order.skipped.total()

    @property
    def damage(self) -> list[str]:
        """Return the damage found so far, one line per file."""
        return self._recording.damage

    @property
    def warnings(self) -> list[str]:
        """Return the problems since iteration began, one line each with its count."""
        lines = [*self.damage, *(f"{self._recording.path}: {line}" for line in self._infos.warnings.values())]
        notes = [*self._recording.notes, *self._notes]
        lines += [f"{self._recording.path}: {note}" for note in notes]
        if self._units.doubt:
            lines.append(f"{self._recording.path}: {self.topic.name}: {self._units.doubt}")
        lines += [f"{self._recording.path}: {self.topic.name}: {line}" for line in self._order.warnings]
        for reason, count in (self._dropped + self._order.skipped).items():
            frames = "1 frame was" if count == 1 else f"{count} frames were"
            lines.append(f"{frames} dropped: {self._recording.path}: {self.topic.name}: {reason}")
        return lines

    def __iter__(self) -> Iterator[DepthFrame]:
        self._forget()
        used = 0
        is_cloud = self.topic.kind == schemas.POINT_CLOUD
        for frame in self._order(self._clouds() if is_cloud else self._images()):
            used += 1
            yield frame
        if self._tell and used:
            tell_damage(self.damage)
        if not used:
            raise InputError("; ".join(self.warnings) or f"{self._recording.path} has no frames")

    def _clouds(self) -> Iterator[tuple[int, DepthFrame]]:
        for message in self._recording.messages(self.topic.name):
            try:
                frame = frame_of_cloud(message.data, self._unit_m)
            except InputError as error:
                self._dropped[str(error)] += 1
                continue
            if not self._notes and frame.frame_id.endswith(OPTICAL) and is_turned(message.data, frame):
                self._notes.append(f"{BODY_AXES}{frame.frame_id}")
            self._check_unit(frame, 1.0)
            yield message.log_time_ns, frame

    def _images(self) -> Iterator[tuple[int, DepthFrame]]:
        rectified = is_rectified(self.topic.name)
        for log_time_ns, image, info in self._paired():
            if info is None:
                self._dropped[self._infos.why_none(image.header.frame_id)] += 1
                continue
            try:
                frame = make_frame(image, self.topic.kind, info, rectified, self._unit_m)
            except InputError as error:
                self._dropped[str(error)] += 1
                continue
            is_plain = self.topic.kind == schemas.IMAGE
            if is_plain and not self._notes and has_wrong_order(image):
                self._notes.append(WRONG_ORDER)
            encoding = image.encoding if is_plain else image.format.partition(";")[0].strip()
            self._check_unit(frame, unit_of(encoding))
            yield log_time_ns, frame

    def _paired(self) -> Iterator[tuple[int, Any, Any]]:
        """Yield log time, image, and the CameraInfo of its frame_id and, if there is one, of its stamp.

        That one may be recorded shortly after the image, which waits for it until the next image.
        """
        image: Any = None  # the waiting image, and its camera as known on arrival
        known: Any = None
        time_ns = 0
        for message in self._recording.messages(self.topic.name, self.topic.info_topic):
            if message.topic == self.topic.info_topic:
                self._add_info(message)
            else:
                if image is not None:
                    yield time_ns, image, known
                time_ns = message.log_time_ns
                image = self._read_image(message)
                known = None if image is None else self._info_for(image)
            if image is not None and self._infos.has_stamp(image.header.frame_id, stamp_of(image)):
                yield time_ns, image, self._info_for(image)
                image = None
        if image is not None:
            yield time_ns, image, known

    def _read_image(self, message: RawMessage) -> Any:
        try:
            return read_message(message.data, self.topic.kind)
        except InputError as error:
            self._dropped[str(error)] += 1
            return None

    def _add_info(self, message: RawMessage, is_ahead: bool = False) -> None:
        try:
            info = read_message(message.data, schemas.CAMERA_INFO)
        except InputError as error:
            if not is_ahead:
                self._infos.refuse(str(error))
        else:
            self._infos.add(info, stamp_of(info), is_ahead)

    def _info_for(self, image: Any) -> Any:
        """Return an image's CameraInfo; the first of its camera may be recorded after it."""
        frame_id = image.header.frame_id
        found = self._infos.find(frame_id)
        if found is None and frame_id not in self._looked_for:
            self._looked_for.add(frame_id)
            for message in self._recording.messages(self.topic.info_topic):
                self._add_info(message, is_ahead=True)
                if (found := self._infos.find(frame_id)) is not None:
                    break
            else:
                self._infos.accept_only()
                found = self._infos.find(frame_id)
        return found

    def _check_unit(self, frame: DepthFrame, unit_m: float) -> None:
        if not self._is_unit_given:
            self._units.look(frame.depth, self._unit_m or unit_m)


def _realsense_unit_m(recording: Recording, topic: str) -> float | None:
    """Return the unit of librealsense's depth images, metres; None for all others."""
    found = _REALSENSE.fullmatch(topic)
    unit = recording.first(f"{found[1]}/option/Depth_Units/value") if found else None
    if unit is None or len(unit.data) != 8:
        return None
    (metres,) = struct.unpack("<f", unit.data[4:])  # std_msgs/Float32
    unit_m = round(float(metres), 9)
    return unit_m if 1e-6 <= unit_m <= 1.0 and unit_m != INTEGER_UNIT_M else None


def frame_of_image(
    data: bytes, kind: str, info_data: bytes, rectified: bool = False, unit_m: float | None = None
) -> DepthFrame:
    """Build a frame from an Image's or CompressedImage's CDR bytes and its camera's calibration.

    A rectified image (`depth_pose.io.calibration.is_rectified`) is used unchanged. ``unit_m`` is metres per
    unit of the depth, where it is not the encoding's.
    """
    image, info = read_message(data, kind), read_message(info_data, schemas.CAMERA_INFO)
    return make_frame(image, kind, info, rectified, unit_m)


def make_frame(
    image: Any, kind: str, info: Any, rectified: bool = False, unit_m: float | None = None
) -> DepthFrame:
    """Build a frame from a decoded Image or CompressedImage and its CameraInfo; see `frame_of_image`."""
    if kind == schemas.COMPRESSED:
        depth = decode_compressed_depth(image.format, image.data, unit_m)
    else:
        size = (image.height, image.width, image.step, image.encoding)
        is_big = bool(image.is_bigendian) != has_wrong_order(image)
        depth = decode_depth(image.data, *size, is_big, unit_m)
    ideal = rectify_depth(depth, lens_of_image(info, depth.shape[0], depth.shape[1], rectified))
    return DepthFrame(stamp_of(image), image.header.frame_id, ideal.depth, ideal.camera, ideal.filled)


def has_wrong_order(image: Any) -> bool:
    """Check whether an Image has the other byte order than it says."""
    size = (image.height, image.width, image.step, image.encoding)
    return is_order_wrong(image.data, *size, image.is_bigendian)


def is_turned(data: bytes, frame: DepthFrame) -> bool:
    """Check whether a cloud was turned to optical axes."""
    return bool(read_message(data, schemas.POINT_CLOUD).header.frame_id != frame.frame_id)


def frame_of_cloud(data: bytes, unit_m: float | None = None) -> DepthFrame:
    """Build a frame from a PointCloud2's CDR bytes, whose unit is ``unit_m`` metres, by default 1."""
    cloud = read_message(data, schemas.POINT_CLOUD)
    fields = {field.name: (field.offset, field.datatype) for field in cloud.fields}
    steps = (cloud.point_step, cloud.row_step)
    points = decode_points(cloud.data, cloud.height, cloud.width, *steps, fields, cloud.is_bigendian)
    if unit_m is not None:
        points *= np.float32(unit_m)
    return frame_from_cloud(points, stamp_of(cloud), cloud.header.frame_id)


def read_frames(
    path: Path | str, depth_topic: str | None = None, images: ImageOptions | None = None
) -> Iterator[DepthFrame]:
    """Yield the depth frames of a recording, in order; dropped frames are logged at the end.

    Parameters
    ----------
    path, depth_topic, images
        As for `DepthReader`.

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
