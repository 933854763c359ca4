"""Read one recording for a calibration: everybody's skeletons, the empty room, static transforms."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from depth_pose.bank.bank import Bank
from depth_pose.core.config import PipelineConfig, SmoothConfig
from depth_pose.core.errors import InputError
from depth_pose.core.workers import Tell
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.static_transforms import StaticTransform, read_static_transforms
from depth_pose.pipeline import PosePipeline
from depth_pose.rooms.background import BackgroundBuilder
from depth_pose.rooms.calibration_input import CameraRecord

_LEAST_STEP_NS = 50_000_000
"""Minimum time between two frames: 20 a second suffice. Set by hand."""
_IMAGE_STEP_NS = 500_000_000
"""Time from one depth image of the empty room to the next, nanoseconds. Set by hand."""


@dataclass(frozen=True)
class RecordSetting:
    """How recordings are read.

    Attributes
    ----------
    bank : str
        The bank's file.
    depth_topic : str or None
        None for the only one.
    seconds : float or None
        Length that is used, from the beginning; None for all.
    """

    bank: str
    depth_topic: str | None = None
    seconds: float | None = None


@dataclass(frozen=True)
class Recorded:
    """Result of one recording: the camera's record, its ``/tf_static``, and damage, one line each."""

    record: CameraRecord
    transforms: tuple[StaticTransform, ...]
    warnings: tuple[str, ...]


def read_record(recording: str, name: str, setting: RecordSetting, tell: Tell) -> Recorded:
    """Find the people of a recording and its empty room.

    Parameters
    ----------
    recording : str
        File or folder.
    name : str
        The camera's name.
    setting : RecordSetting
    tell : callable
        Called with the fraction done.

    Raises
    ------
    InputError
        Where the recording cannot be read.
    """
    reader = DepthReader(Path(recording), setting.depth_topic, tell=False)
    # a low-pass filter lags by more at a low frame rate, so cameras with different rates would not agree
    pipeline = PosePipeline(Bank.load(setting.bank), PipelineConfig(smooth=SmoothConfig(enabled=False)))
    record = CameraRecord(name, topic=reader.topic.name)
    room = BackgroundBuilder()
    first_ns = last_ns = image_ns = -(10**18)
    for number, frame in enumerate(reader):
        if record.camera is None:
            record.camera, record.frame_id, first_ns = frame.camera, frame.frame_id, frame.stamp_ns
        elif frame.camera != record.camera:
            raise InputError(f"{recording}: the camera's image or calibration changes at frame {number}")
        if setting.seconds is not None and frame.stamp_ns - first_ns > 1e9 * setting.seconds:
            break
        tell(number / max(len(reader), 1))
        if 0 <= frame.stamp_ns - last_ns < _LEAST_STEP_NS:
            continue
        last_ns = frame.stamp_ns
        result = pipeline.process_frame(frame)
        record.add(frame.stamp_ns, result.skeletons)
        if not 0 <= frame.stamp_ns - image_ns < _IMAGE_STEP_NS:
            image_ns = frame.stamp_ns
            room.add(frame, result.people)
    record.background = room.room()
    record.upside_down = "; ".join(pipeline.warnings)
    return Recorded(record, read_static_transforms(recording), tuple(reader.warnings))
