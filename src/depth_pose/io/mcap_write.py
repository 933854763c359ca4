"""Writing of recordings: skeletons, and depth images with their camera.

The same input gives the same bytes: every message is logged at its own stamp, and nothing depends on the
machine or the current time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.outputs import NewFile
from depth_pose.core.result import Skeleton
from depth_pose.io import markers, schemas
from depth_pose.io.messages import write_camera_info, write_image
from depth_pose.io.schemas import DEPTH_TOPIC, PEOPLE_TOPIC, SKELETON_TOPIC
from depth_pose.io.skeleton_cdr import write_people, write_skeleton

_Writer = TypeVar("_Writer", bound="RecordingWriter")


class PartlyWritten(KeyboardInterrupt):
    """Interruption by Ctrl-C; the messages written so far are in a separate file.

    Attributes
    ----------
    path : Path
        That file, ``NAME.partial.mcap``.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(f"the messages written before that are in {path}")
        self.path = path


class RecordingWriter:
    """A recording that gets its name only when it is complete.

    As a context manager it is closed at the end; after an error, or Ctrl-C, an existing file is left
    unchanged. Messages written before Ctrl-C are kept as ``NAME.partial.mcap`` (`PartlyWritten`), unless only
    complete files are wanted.
    """

    def __init__(self, path: Path | str, only_whole: bool = False) -> None:
        self._path = Path(path)
        self._only_whole = only_whole
        self._file = NewFile(self._path)
        self._writer = Writer(self._file.stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="depth_pose")
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}

    def write_message(self, topic: str, kind: str, stamp_ns: int, data: bytes, text: str = "") -> None:
        """Add an encoded message.

        Parameters
        ----------
        topic : str
        kind : str
            ROS type, as ``sensor_msgs/msg/Image``.
        stamp_ns : int
            Nanoseconds; the time at which the message is logged.
        data : bytes
            CDR, little endian.
        text : str, optional
            Definition of the type, where `depth_pose.io.schemas` has none.
        """
        if topic not in self._channels:
            text = text or schemas.schema_text(kind)
            schema = self._writer.register_schema(kind, "ros2msg", text.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
            self._counts[topic] = 0
        if stamp_ns < 0:
            raise InputError(f"{self._path}: stamp {stamp_ns} ns is below 0")
        with self._file.telling():
            self._writer.add_message(
                self._channels[topic],
                log_time=stamp_ns,
                publish_time=stamp_ns,
                data=data,
                sequence=self._counts[topic],
            )
        self._counts[topic] += 1

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record to the file."""
        self._writer.add_metadata(name, dict(values))

    def close(self) -> None:
        """Finish the file and give it its name."""
        self._finish()
        self._file.keep()

    def _finish(self) -> None:
        try:
            with self._file.telling():
                self._writer.finish()  # type: ignore[no-untyped-call]
        except BaseException:
            self.discard()
            raise

    def discard(self) -> None:
        """Delete the messages written so far."""
        self._file.discard()

    def __enter__(self: _Writer) -> _Writer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        elif issubclass(kind, KeyboardInterrupt) and not self._only_whole and self._counts:
            self._finish()
            raise PartlyWritten(self._file.keep_partial()) from error
        else:
            self.discard()


class SkeletonWriter(RecordingWriter):
    """Writes ``depth_pose_msgs/msg/Skeleton`` messages, and ``SkeletonArray`` messages of all people.

    Parameters
    ----------
    path : Path or str
        The MCAP file; folders are created, an existing file is replaced.
    only_whole : bool
        After Ctrl-C, delete the partial file.
    """

    def write(self, skeleton: Skeleton) -> None:
        """Add one skeleton at its stamp, on `SKELETON_TOPIC`."""
        self.write_message(SKELETON_TOPIC, schemas.SKELETON, skeleton.stamp_ns, write_skeleton(skeleton))

    def write_people(self, skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> None:
        """Add all people of a frame, on `PEOPLE_TOPIC`."""
        data = write_people(skeletons, stamp_ns, frame_id)
        self.write_message(PEOPLE_TOPIC, schemas.SKELETON_ARRAY, stamp_ns, data)

    def write_markers(self, skeletons: Sequence[Skeleton], stamp_ns: int, frame_id: str) -> None:
        """Add the markers of all people, on `markers.MARKERS_TOPIC`."""
        data = markers.write_markers(skeletons, stamp_ns, frame_id)
        self.write_message(markers.MARKERS_TOPIC, markers.MARKER_ARRAY, stamp_ns, data, markers.definition())


class DepthWriter(RecordingWriter):
    """Writes a depth camera's images and calibration.

    Parameters
    ----------
    path : Path or str
        The MCAP file; folders are created, an existing file is replaced.
    camera : Camera
        The camera of all images.
    frame_id : str
        Name of the optical frame.
    topic : str
        The images' topic; the calibration goes to ``camera_info`` beside it.
    encoding : str
        ``16UC1`` (whole millimetres) or ``32FC1`` (metres).
    """

    def __init__(
        self,
        path: Path | str,
        camera: Camera,
        frame_id: str,
        topic: str = DEPTH_TOPIC,
        encoding: str = "16UC1",
    ) -> None:
        if encoding not in ("16UC1", "32FC1"):
            raise InputError(f"{path}: encoding is {encoding!r}; it must be 16UC1 or 32FC1")
        super().__init__(path, only_whole=True)
        self._camera = camera
        self._frame_id = frame_id
        self._topic = topic
        self._info_topic = topic.rpartition("/")[0] + "/camera_info"
        self._encoding = encoding

    def write(self, stamp_ns: int, depth: NDArray[np.float32]) -> None:
        """Add one image and its calibration.

        Parameters
        ----------
        stamp_ns : int
            Nanoseconds.
        depth : (H, W) float32
            Metres; 0 or NaN without a measurement. 16UC1 holds up to 65.535 m.
        """
        if depth.shape != (self._camera.height, self._camera.width):
            raise InputError(
                f"{self._path}: the image is {depth.shape[1]} x {depth.shape[0]}, "
                f"the camera has {self._camera.width} x {self._camera.height}"
            )
        info = write_camera_info(stamp_ns, self._frame_id, self._camera)
        self.write_message(self._info_topic, schemas.CAMERA_INFO, stamp_ns, info)
        if self._encoding == "16UC1":
            mm = np.rint(np.nan_to_num(depth, posinf=0.0, neginf=0.0).astype(np.float64) * 1000.0)
            image = write_image(
                stamp_ns, self._frame_id, np.where(mm <= 65535, mm.clip(0), 0).astype(np.uint16)
            )
        else:
            image = write_image(stamp_ns, self._frame_id, depth.astype(np.float32))
        self.write_message(self._topic, schemas.IMAGE, stamp_ns, image)

    def write_frame(self, frame: DepthFrame) -> None:
        """Add a `DepthFrame` of the same camera."""
        self.write(frame.stamp_ns, frame.depth)
