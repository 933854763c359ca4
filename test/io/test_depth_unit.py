"""Depths in another unit than their type stands for: said with what sets it, and right once it is set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.camera import Camera
from depth_pose.io import schemas
from depth_pose.io.depth_unit import UnitWatch
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.mcap_write import RecordingWriter
from depth_pose.io.messages import write_camera_info, write_image

CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
INFO = schemas.DEPTH_TOPIC.rpartition("/")[0] + "/camera_info"


class Writer(RecordingWriter):
    def frame(self, at: int, pixels: np.ndarray) -> None:
        self.write_message(INFO, schemas.CAMERA_INFO, at, write_camera_info(at, "cam", CAMERA))
        self.write_message(schemas.DEPTH_TOPIC, schemas.IMAGE, at, write_image(at, "cam", pixels))


def room() -> np.ndarray:
    """A wall at 2.5 m with somebody at 1.8 m before it, metres."""
    depth = np.full((48, 64), 2.5)
    depth[10:, 20:34] = 1.8
    depth[:4, :4] = 0.0
    return depth


UNITS = [("uint16", 0.0001), ("uint16", 1.0), ("float32", 0.001)]


@pytest.mark.parametrize(("kind", "unit"), UNITS)
def test_another_unit_is_said_and_the_option_sets_it(tmp_path: Path, kind: str, unit: float) -> None:
    path = tmp_path / "a.mcap"
    with Writer(path) as out:
        for i in range(4):
            out.frame(i + 1, np.round(room() / unit).astype(kind))
    reader = DepthReader(path)
    assert len(list(reader)) == 4
    (line,) = reader.warnings
    assert (
        "look like another unit" in line
        and f"--depth-scale sets the metres per unit, here perhaps {unit:g}" in line
    )
    right = DepthReader(path, images=ImageOptions(depth_scale=unit))
    depth = next(iter(right)).depth
    np.testing.assert_allclose(depth, np.round(room() / unit) * unit, rtol=1e-6)
    assert list(right) and right.warnings == []


@pytest.mark.parametrize(("kind", "unit"), [("uint16", 0.001), ("float32", 1.0)])
def test_the_usual_units_are_not_doubted(tmp_path: Path, kind: str, unit: float) -> None:
    with Writer(tmp_path / "a.mcap") as out:
        for i in range(4):
            out.frame(i + 1, np.round(room() / unit, 3).astype(kind))
    reader = DepthReader(tmp_path / "a.mcap")
    assert len(list(reader)) == 4 and reader.warnings == []


def test_a_hand_before_the_lens_and_empty_frames_are_no_doubt() -> None:
    watch = UnitWatch("--depth-scale")
    for depth in (np.zeros((48, 64), np.float32), np.full((48, 64), 0.05, np.float32)):
        watch.look(depth, 0.001)
    assert watch.doubt
    for _ in range(2):
        watch.look(room().astype(np.float32), 0.001)
    assert watch.doubt == ""
