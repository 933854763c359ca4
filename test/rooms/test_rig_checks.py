"""Rig files with numbers that no rig has are refused when they are read, with what they look like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.rooms.rig_checks import check_recorded
from depth_pose.rooms.rigfile import load_rig
from room_scene import CAMERAS, write_rig


def spoil(tmp_path: Path, **changes):
    """A rig file whose second camera has other values."""
    path = write_rig(tmp_path / "rig.yaml")
    values = yaml.safe_load(path.read_text())
    for name, change in changes.items():
        values["cameras"][1][name] = change(values["cameras"][1][name])
    path.write_text(yaml.safe_dump(values))
    return path


def with_last_row(row):
    return lambda T: [*T[:3], row]


def scaled(T):
    return (np.diag([2.0, 2.0, 2.0, 1.0]) @ np.array(T)).tolist()


def in_mm(T):
    return [[*row[:3], 1000.0 * row[3] if i < 3 else row[3]] for i, row in enumerate(T)]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"T_camera_world": with_last_row([0.0] * 4)}, "the last row is"),
        ({"T_camera_world": with_last_row([0.0, 0.0, 0.0, 2.0])}, "the last row is"),
        ({"T_camera_world": lambda T: np.transpose(T).tolist()}, "looks transposed"),
        ({"T_camera_world": scaled}, "scaled by 2"),
        ({"T_camera_world": in_mm}, "metres, not millimetres"),
        ({"T_camera_world": lambda T: [[*T[0][:3], 1e300], *T[1:]]}, "from the origin"),
        ({"T_camera_world": lambda T: [[1e300, *T[0][1:]], *T[1:]]}, "does not hold a rotation"),
        ({"T_camera_world": lambda T: [[-x for x in T[0]], *T[1:]]}, "mirror image"),
        ({"T_camera_world": lambda T: np.full((4, 4), np.nan).tolist()}, "all finite"),
        ({"clock_offset": lambda s: 1e300}, "clock_offset is 1e\\+300 s"),
        ({"clock_offset": lambda s: float("inf")}, "all finite"),
        ({"size": lambda s: [0, 96]}, "positive"),
        ({"intrinsics": lambda s: [1e9, 1e9, 63.5, 47.5]}, "focal lengths"),
        ({"intrinsics": lambda s: [110.0, 110.0, 9000.0, 47.5]}, "principal point"),
    ],
)
def test_a_rig_is_checked_when_it_is_read(tmp_path: Path, changes, says: str) -> None:
    with pytest.raises(ConfigError, match=says) as error:
        load_rig(spoil(tmp_path, **changes))
    assert "cameras[1]" in str(error.value) or "camera1" in str(error.value)


def test_a_good_rig_is_read(tmp_path: Path) -> None:
    rig = load_rig(write_rig(tmp_path / "rig.yaml"))
    for read, known in zip(rig.cameras, CAMERAS, strict=True):
        np.testing.assert_allclose(read.T_camera_world, known.T_camera_world, atol=1e-9)


def test_recordings_of_other_cameras_are_refused_with_whose_they_are() -> None:
    a, b = Camera(160, 120, 140.0, 140.0, 79.5, 59.5), Camera(128, 96, 110.0, 110.0, 63.5, 47.5)
    paths = [Path("one.mcap"), Path("two.mcap")]
    check_recorded(("a", "b"), (a, b), paths, (a, b._replace(fx=110.9)))
    with pytest.raises(InputError, match=r"one.mcap is not of a.*it fits b: is the order"):
        check_recorded(("a", "b"), (a, b), paths, (b, a))
    with pytest.raises(InputError, match=r"two.mcap is not of b.*focal lengths 90.0.*calibrate again"):
        check_recorded(("a", "b"), (a, b), paths, (a, b._replace(fx=90.0)))
