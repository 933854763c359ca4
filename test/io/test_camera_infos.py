"""CameraInfo of several cameras on one topic, and cameras that change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.io import schemas
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.mcap_write import RecordingWriter
from depth_pose.io.messages import write_camera_info, write_image

TOPIC, INFO = schemas.DEPTH_TOPIC, "/camera/depth/camera_info"
CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
OTHER = Camera(64, 48, 80.0, 80.0, 31.5, 23.5)
SMALL = Camera(32, 24, 30.0, 30.0, 15.5, 11.5)


class Writer(RecordingWriter):
    """Images and CameraInfos in any order."""

    def image(
        self, at: int, camera: Camera = CAMERA, frame_id: str = "cam", stamp: int | None = None
    ) -> None:
        pixels = np.full((camera.height, camera.width), 2000, np.uint16)
        data = write_image(at if stamp is None else stamp, frame_id, pixels)
        self.write_message(TOPIC, schemas.IMAGE, at, data)

    def info(self, at: int, camera: Camera = CAMERA, frame_id: str = "cam", stamp: int | None = None) -> None:
        data = write_camera_info(at if stamp is None else stamp, frame_id, camera)
        self.write_message(INFO, schemas.CAMERA_INFO, at, data)


def read(path: Path) -> tuple[list[float], list[str]]:
    """Focal length of every frame, and what is warned of."""
    reader = DepthReader(path)
    focal = [frame.camera.fx for frame in reader]
    return focal, reader.warnings


def test_another_camera_on_the_topic_is_not_used_counted_and_said_once(tmp_path: Path) -> None:
    with Writer(tmp_path / "a.mcap") as out:
        for i in range(10):
            out.info(10 * i + 1, OTHER, "colour")
            out.image(10 * i + 2, frame_id="/cam")
            out.info(10 * i + 3, CAMERA, "cam", stamp=10 * i + 2)
            out.info(10 * i + 4, OTHER, "colour")
    focal, warnings = read(tmp_path / "a.mcap")
    assert focal == [60.0] * 10
    assert len(warnings) == 1
    assert "20 CameraInfos of another camera ignored ('colour')" in warnings[0]


def test_only_another_name_is_used_and_said(tmp_path: Path) -> None:
    with Writer(tmp_path / "a.mcap") as out:
        out.info(1, CAMERA, "colour")
        for i in range(2, 5):
            out.image(i)
    focal, warnings = read(tmp_path / "a.mcap")
    assert focal == [60.0] * 3
    assert len(warnings) == 1 and "'colour'" in warnings[0] and "'cam'" in warnings[0]


def test_two_other_names_are_refused_with_both(tmp_path: Path) -> None:
    with Writer(tmp_path / "a.mcap") as out:
        out.info(1, CAMERA, "left")
        out.info(2, OTHER, "right")
        out.image(3)
    with pytest.raises(InputError, match=r"frame_id 'left', 'right', the image is of 'cam'"):
        list(DepthReader(tmp_path / "a.mcap"))


def test_an_image_takes_the_info_of_its_stamp_though_it_comes_later(tmp_path: Path) -> None:
    with Writer(tmp_path / "a.mcap") as out:
        for i in range(6):
            camera = CAMERA if i < 3 else SMALL
            out.image(10 * i + 1, camera)
            out.info(10 * i + 5, camera, stamp=10 * i + 1)
    reader = DepthReader(tmp_path / "a.mcap")
    assert [frame.camera for frame in reader] == [CAMERA] * 3 + [SMALL] * 3
    assert reader.warnings == [
        f"{tmp_path / 'a.mcap'}: {INFO}: the camera 'cam' changes: 64 x 48, fx 60.0 -> 32 x 24, fx 30.0"
    ]


def test_a_camera_that_does_not_change_is_no_news(tmp_path: Path) -> None:
    with Writer(tmp_path / "a.mcap") as out:
        for i in range(20):
            out.image(10 * i + 1)
            out.info(10 * i + 2, stamp=10 * i + 1)
    assert read(tmp_path / "a.mcap") == ([60.0] * 20, [])


def test_a_damaged_info_is_counted_and_the_one_before_stays(tmp_path: Path) -> None:
    with Writer(tmp_path / "a.mcap") as out:
        out.info(1)
        out.write_message(INFO, schemas.CAMERA_INFO, 2, b"\x00\x01\x00\x00")
        out.image(3)
    focal, warnings = read(tmp_path / "a.mcap")
    assert focal == [60.0]
    assert len(warnings) == 1 and "damaged" in warnings[0]
