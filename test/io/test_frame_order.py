"""Frames of recordings with spoilt stamps come out in order, and what was done is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.io import schemas
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.mcap_write import RecordingWriter
from depth_pose.io.messages import write_camera_info, write_image
from stamp_cases import FRAMES, StampCase, cases

TOPIC, INFO = schemas.DEPTH_TOPIC, "/camera/depth/camera_info"
CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)


def write(path: Path, case: StampCase) -> Path:
    """Each image shows its number: 1000 mm and the number of the frame."""
    with RecordingWriter(path) as out:
        for number, stamp_ns, log_ns in zip(case.frames, case.stamps_ns, case.log_ns, strict=True):
            info = write_camera_info(stamp_ns, "cam", CAMERA)
            out.write_message(INFO, schemas.CAMERA_INFO, log_ns, info)
            pixels = np.full((48, 64), 1000 + number, np.uint16)
            out.write_message(TOPIC, schemas.IMAGE, log_ns, write_image(stamp_ns, "cam", pixels))
    return path


@pytest.mark.parametrize("case", list(cases()), ids=lambda case: case.name)
def test_frames_are_in_order_and_none_is_lost_without_a_word(tmp_path: Path, case: StampCase) -> None:
    reader = DepthReader(write(tmp_path / "a.mcap", case))
    for _ in range(2):  # and the same when it is read again
        frames = list(reader)
        assert [round(float(f.depth[0, 0]) * 1000) - 1000 for f in frames] == case.kept
        assert reader.dropped == FRAMES - len(case.kept) or case.name == "some twice"
        said = " ".join(reader.warnings)
        assert case.says in said and bool(case.says) == bool(said)
    if case.uses_log_times:
        assert [f.stamp_ns for f in frames] == case.log_ns
    else:
        stamp_of = dict(zip(case.frames, case.stamps_ns, strict=True))
        assert [f.stamp_ns for f in frames] == [stamp_of[i] for i in case.kept]
