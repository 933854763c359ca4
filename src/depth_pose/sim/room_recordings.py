"""Recordings of people in one room by several cameras, with the truth in the room's frame.

For ``NAME.mcap`` there are ``NAME_0.mcap``, ``NAME_1.mcap``, ... (each camera's depth images),
``NAME.yaml`` (the true rig, `depth_pose.rooms.rigfile`) and ``NAME.npz``, the truth. The room's frame has
z up, the floor at z = 0, its origin below camera 0 and x along camera 0's view. Camera 0's clock is the
true time. With T frames of camera 0, P people and M cameras the truth holds:

============================ =====================================================================
``joints`` (T, P, 19, 3)     float32, room's frame, metres
``names`` (19,)
``stamps_ns`` (T,)           camera 0's frames, by its clock
``seen`` (T, P, 19)          whether any camera sees the joint
``visible`` (T, P)           share of the person's silhouette in the image of the camera that shows most
``seen_by`` (M, T, P, 19)    whether a camera sees the joint, in its frame nearest in true time
``visible_by`` (M, T, P)     likewise the share of the silhouette
``clock_offsets_s`` (M,)     a camera's clock minus camera 0's, at the first frame of camera 0, seconds
``clock_drifts`` (M,)        growth of that difference, seconds per second
``T_camera_world`` (M, 4, 4) from the room's frame to the optical frames
============================ =====================================================================
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from depth_pose.core.errors import ConfigError
from depth_pose.core.outputs import new_file
from depth_pose.core.skeleton import JOINTS
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.io.schemas import DEPTH_TOPIC
from depth_pose.rooms.rig import RigCamera
from depth_pose.rooms.rigfile import save_rig, upright_from
from depth_pose.sim.config import MAX_CAMERAS
from depth_pose.sim.performers import Performer, Track
from depth_pose.sim.play import furnish_around, person_at, sample_long_track, sample_stage
from depth_pose.sim.room_cameras import RoomCamera, place_cameras
from depth_pose.sim.scenes import render
from depth_pose.sim.shapes import Triangles
from depth_pose.sim.simulate import START_NS

_MOTION_FPS = 60.0
"""Rate at which motion is made; between its frames, where cameras sample it, segments rotate evenly."""


@dataclass(frozen=True)
class RoomShow:
    """People, a room and its cameras, ready to be recorded.

    Attributes
    ----------
    cast : tuple of (Performer, Track)
        People and their motion.
    surfaces : Triangles
        Of the room, y up.
    cameras : tuple of RoomCamera
    seconds : float
    noise_seed : int
    """

    cast: tuple[tuple[Performer, Track], ...]
    surfaces: Triangles
    cameras: tuple[RoomCamera, ...]
    seconds: float
    noise_seed: int

    @property
    def frames(self) -> int:
        """Number of frames of all cameras."""
        return sum(len(c.times(self.seconds)) for c in self.cameras)


def sample_show(
    rng: np.random.Generator,
    cameras: int = 2,
    seconds: float = 10.0,
    people: int = 2,
    width: int = 320,
    max_clock_offset: float = 0.02,
) -> RoomShow:
    """Sample people, their motion, a furnished room and the cameras around it.

    Parameters
    ----------
    rng : numpy.random.Generator
        Same state, same show.
    cameras : int
        Number of cameras, 1 to `depth_pose.sim.config.MAX_CAMERAS`.
    seconds : float
    people : int
        Number of people; fewer if the room has no space for their paths.
    width : int
        Maximum width of the images, pixels.
    max_clock_offset : float
        Maximum difference of a camera's clock from camera 0's, seconds.

    Raises
    ------
    ConfigError
        For a wrong number of cameras.
    """
    if not 1 <= cameras <= MAX_CAMERAS:
        raise ConfigError(f"{cameras} cameras cannot be simulated; a room has 1 to {MAX_CAMERAS}")
    with threadpool_limits(1):  # sums in the same order on any number of cores
        view, room = sample_stage(rng, width)
        frames = 1 + int(np.ceil((seconds + 0.1) * _MOTION_FPS))
        cast: list[tuple[Performer, Track]] = []
        for i in range(people):
            performer = Performer(rng, _MOTION_FPS)
            others = [track for _, track in cast]
            track = sample_long_track(rng, performer, view, room, others, frames, may_sit=i == 0)
            if track is not None:
                cast.append((performer, track))
        surfaces = furnish_around(rng, room, view, cast)
        placed = place_cameras(rng, cameras, view, room, surfaces, cast, width, max_clock_offset)
    return RoomShow(tuple(cast), surfaces, placed, seconds, int(rng.integers(2**31)))


def recordings_of(path: Path, cameras: int) -> list[Path]:
    """Return the cameras' recordings ``NAME_0.mcap``, ``NAME_1.mcap``, ... of ``NAME.mcap``."""
    return [path.with_name(f"{path.stem}_{i}.mcap") for i in range(cameras)]


@dataclass
class _Log:
    """What one camera sees of people: one entry per frame."""

    joints: list[NDArray[np.float64]]
    seen: list[NDArray[np.bool_]]
    visible: list[NDArray[np.float32]]


def record_show(path: Path, show: RoomShow, progress: Callable[[int], None] | None = None) -> float:
    """Write every camera's recording, the rig and the truth.

    Frames are rendered in the order of true time and written at once.

    Parameters
    ----------
    path : Path
        ``NAME.mcap``; see the module for the files.
    show : RoomShow
    progress : callable, optional
        Called with the number of frames done, of all cameras.

    Returns
    -------
    float
        Mean visible share of a person in the best camera; 0 without people.
    """
    times = [c.times(show.seconds) for c in show.cameras]
    stamps = [c.stamps_ns(t, START_NS) for c, t in zip(show.cameras, times, strict=True)]
    logs = [_Log([], [], []) for _ in show.cameras]
    order = sorted((t, i, k) for i, ts in enumerate(times) for k, t in enumerate(ts))
    noise = [np.random.default_rng([show.noise_seed, i]) for i in range(len(show.cameras))]
    acting = [[(p, track.at(ts * p.fps)) for p, track in show.cast] for ts in times]
    with ExitStack() as stack:
        stack.enter_context(threadpool_limits(1))
        beside = stack.enter_context(new_file(path.with_suffix(".npz")))
        writers = [
            stack.enter_context(DepthWriter(file, c.view.camera, f"camera{i}_depth_optical_frame"))
            for i, (file, c) in enumerate(
                zip(recordings_of(path, len(show.cameras)), show.cameras, strict=True)
            )
        ]
        for done, (_, i, k) in enumerate(order):
            persons = [person_at(p, track, k) for p, track in acting[i]]
            camera = show.cameras[i]
            steady = show.noise_seed + i
            scene = render(camera.view, show.surfaces, persons, camera.sensor, noise[i], steady)
            writers[i].write(int(stamps[i][k]), scene.depth)
            logs[i].joints.append(np.array([p.joints for p in persons]).reshape(-1, 19, 3))
            logs[i].seen.append(scene.seen)
            logs[i].visible.append(scene.visible)
            if progress:
                progress(done + 1)
        truth = _truth(show, times, logs)
        truth["stamps_ns"] = stamps[0]
        np.savez_compressed(beside, **truth)  # type: ignore[arg-type]
    rig = [RigCamera(f"camera{i}", c.view.camera, c.view.T_camera_room) for i, c in enumerate(show.cameras)]
    save_rig(path.with_suffix(".yaml"), rig, [DEPTH_TOPIC] * len(rig))
    return float(truth["visible"].mean()) if truth["visible"].size else 0.0


def _truth(
    show: RoomShow, times: list[NDArray[np.float64]], logs: list[_Log]
) -> dict[str, NDArray[np.generic]]:
    """Collect the arrays of the truth at the frames of camera 0, in the room's frame."""
    nearest = [np.abs(times[0][:, None] - ts).argmin(axis=1) for ts in times]
    seen = np.stack([np.array(log.seen)[k] for log, k in zip(logs, nearest, strict=True)])
    visible = np.stack([np.array(log.visible)[k] for log, k in zip(logs, nearest, strict=True)])
    T_upright_world = upright_from("z")
    return {
        "names": np.array(JOINTS),
        "joints": (np.array(logs[0].joints) @ T_upright_world[:3, :3]).astype(np.float32),
        "seen": seen.any(axis=0),
        "visible": visible.max(axis=0),
        "seen_by": seen,
        "visible_by": visible,
        "clock_offsets_s": np.array([c.clock_offset for c in show.cameras]),
        "clock_drifts": np.array([c.clock_drift for c in show.cameras]),
        "T_camera_world": np.stack([c.view.T_camera_room @ T_upright_world for c in show.cameras]),
    }
