"""Rig files: several cameras, their calibration and their topics.

::

    up: z                     # of the world frame: z as in ROS (REP 103), or y
    cameras:
      - name: camera0
        topic: /camera0/silhouette
        size: [256, 192]
        intrinsics: [190.0, 190.0, 127.5, 95.5]      # fx, fy, cx, cy in pixels
        T_camera_world:                              # world to optical frame, metres
          - [...]
        frame_id: camera0_optical                    # optional: its optical frame's name
        clock_offset: 0.012                          # optional: s to subtract from its stamps
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.outputs import new_text_file
from depth_pose.core.reading import parse_yaml, read_text
from depth_pose.io.calibration import camera_from_info
from depth_pose.rooms.rig import T_WORLD_ROOM, RigCamera
from depth_pose.rooms.rig_checks import check_offset, check_transform

_UPRIGHT: dict[str, NDArray[np.float64]] = {
    "y": np.eye(4),
    "z": T_WORLD_ROOM,
}


def upright_from(up: str) -> NDArray[np.float64]:
    """Return the transform (4, 4) from a world frame with the given up axis to the tracker's, with y up.

    Raises
    ------
    ConfigError
        For another axis than y and z.
    """
    if up not in _UPRIGHT:
        raise ConfigError(f"the world's up axis is {up!r}; it is one of {', '.join(_UPRIGHT)}")
    return _UPRIGHT[up]


@dataclass(frozen=True, eq=False)
class Rig:
    """Cameras with their topics.

    Attributes
    ----------
    cameras : tuple of RigCamera
        In the tracker's world frame, y up.
    topics : tuple of str
    up : str
        Up axis of the world frame in the file, and of published data.
    clock_offsets : tuple of float
        Seconds to subtract from each camera's stamps to get those of the first camera's clock.
    frame_ids : tuple of str
        Name of each camera's optical frame; empty where it is not known.
    """

    cameras: tuple[RigCamera, ...]
    topics: tuple[str, ...] = ()
    up: str = "y"
    clock_offsets: tuple[float, ...] = ()
    frame_ids: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.clock_offsets:
            object.__setattr__(self, "clock_offsets", (0.0,) * len(self.cameras))
        if not self.frame_ids:
            object.__setattr__(self, "frame_ids", ("",) * len(self.cameras))


def load_rig(path: Path) -> Rig:
    """Read a rig file.

    Raises
    ------
    InputError
        Where it cannot be read.
    ConfigError
        Where a field is missing, unknown or of the wrong form; the message names it.
    """
    values = parse_yaml(path, read_text(path))
    if not isinstance(values, dict) or not isinstance(values.get("cameras"), list) or not values["cameras"]:
        raise ConfigError(f"{path}: it must hold a list 'cameras'")
    up = str(values.get("up", "z"))
    T_upright_world = upright_from(up)
    cameras, topics, offsets, frames = [], [], [], []
    for i, entry in enumerate(values["cameras"]):
        where = f"{path}: cameras[{i}]"
        cameras.append(_camera(where, entry, T_upright_world))
        topics.append(str(entry.get("topic", f"/{cameras[-1].name}/silhouette")))
        offset_s = float(_numbers(where, {"clock_offset": 0.0, **entry}, "clock_offset", 1)[0])
        offsets.append(check_offset(where, offset_s))
        frames.append(str(entry.get("frame_id", "")))
    names = [c.name for c in cameras]
    if len(set(names)) < len(names):
        raise ConfigError(f"{path}: two cameras have the same name")
    return Rig(tuple(cameras), tuple(topics), up, tuple(offsets), tuple(frames))


def _camera(where: str, entry: Any, T_upright_world: NDArray[np.float64]) -> RigCamera:
    if not isinstance(entry, dict):
        raise ConfigError(f"{where} must be a mapping")
    known = {"name", "topic", "size", "intrinsics", "T_camera_world", "frame_id", "clock_offset"}
    if set(entry) - known:
        raise ConfigError(f"{where} has unknown fields: {', '.join(sorted(map(str, set(entry) - known)))}")
    name = str(entry.get("name", where))
    width, height = (int(n) for n in _numbers(where, entry, "size", 2).tolist())
    fx, fy, cx, cy = _numbers(where, entry, "intrinsics", 4).tolist()
    if min(width, height) < 1 or min(fx, fy) <= 0:
        raise ConfigError(f"{where}: size and focal lengths must be positive")
    try:
        camera_from_info((fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0), (), width, height)
    except InputError as error:
        raise ConfigError(f"{where}: {str(error).removeprefix('camera_info: ')}") from error
    T_camera_world = _numbers(where, entry, "T_camera_world", 16).reshape(4, 4)
    check_transform(f"{where}.T_camera_world", T_camera_world)
    T_camera_upright = T_camera_world @ np.linalg.inv(T_upright_world)
    return RigCamera(name, Camera(width, height, fx, fy, cx, cy), T_camera_upright)


def _numbers(where: str, entry: dict[str, Any], field: str, count: int) -> NDArray[np.float64]:
    try:
        values = np.asarray(entry[field], np.float64).ravel()
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{where}.{field} is missing or has values that are not numbers") from error
    if values.size != count or not np.isfinite(values).all():
        raise ConfigError(f"{where}.{field} has {values.size} numbers; it must have {count}, all finite")
    return values


def save_rig(
    path: Path,
    cameras: Sequence[RigCamera],
    topics: Sequence[str],
    up: str = "z",
    clock_offsets: Sequence[float] = (),
    frame_ids: Sequence[str] = (),
) -> None:
    """Write a rig file; clock offsets and frame names only where they are known."""
    import yaml

    T_upright_world = upright_from(up)
    entries = []
    for i, (c, topic) in enumerate(zip(cameras, topics, strict=True)):
        entry: dict[str, Any] = {
            "name": c.name,
            "topic": topic,
            "size": [c.camera.width, c.camera.height],
            "intrinsics": [float(v) for v in (c.camera.fx, c.camera.fy, c.camera.cx, c.camera.cy)],
            "T_camera_world": (c.T_camera_world @ T_upright_world).tolist(),
        }
        if frame_ids and frame_ids[i]:
            entry["frame_id"] = frame_ids[i]
        if clock_offsets:
            entry["clock_offset"] = float(clock_offsets[i])
        entries.append(entry)
    with new_text_file(path) as stream:
        yaml.safe_dump({"up": up, "cameras": entries}, stream, sort_keys=False, default_flow_style=None)
