"""Clips of several people in one room, with the truth, for scoring trackers.

People walk from place to place, cross each other, hide behind furniture and each other, leave the image and
come back, stand side by side, and one may sit down. Room, camera, sensor, builds and clothes stay the same.

The truth beside a recording holds ``joints`` (T, P, 19, 3) float32, optical frame, metres; ``seen``
(T, P, 19); ``visible`` (T, P), share of a person's silhouette that the image shows; ``stamps_ns`` (T,);
``names`` (19,); ``K`` (3, 3). Where the camera moves, joints are in its frame at that moment, and
``T_camera_floor`` (T, 4, 4) leads there from the floor's frame (z up, the floor at z = 0). At home,
``materials`` (P, 4) names what each person's hair, top, trousers and shoes are of.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.outputs import new_file
from depth_pose.core.skeleton import JOINTS
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.rooms.rigfile import upright_from
from depth_pose.sim.home_scenes import UPRIGHT_MOUNTINGS, furnished_home
from depth_pose.sim.home_sensors import sample_home_sensor, sample_named_sensor
from depth_pose.sim.performers import Performer, Track
from depth_pose.sim.play import furnish_around, person_at, sample_stage, sample_track
from depth_pose.sim.scene_noise import sample_sensor
from depth_pose.sim.scenes import render, sample_camera
from depth_pose.sim.sensor import SENSORS
from depth_pose.sim.shapes import joined
from depth_pose.sim.simulate import FRAME_ID, START_NS
from depth_pose.sim.walks import free_points, sample_pet_walk, sample_views


@dataclass(frozen=True)
class RoomClip:
    """A video of people in a room, and the truth.

    Attributes
    ----------
    depth : (T, H, W) float32
        Metres; 0 where nothing returned.
    joints : (T, P, 19, 3) float32
        Optical frame, metres.
    seen : (T, P, 19) bool
    visible : (T, P) float32
    stamps_ns : (T,) int64
    camera : Camera
    T_camera_floor : (T, 4, 4) float64
        From the floor's frame (z up, the floor at z = 0, below the room frame's origin) to the optical frame.
    moves : bool
        Whether the camera moves.
    materials : tuple of tuple of str
        Of each person's hair, top, trousers and shoes; empty where unknown.
    """

    depth: NDArray[np.float32]
    joints: NDArray[np.float32]
    seen: NDArray[np.bool_]
    visible: NDArray[np.float32]
    stamps_ns: NDArray[np.int64]
    camera: Camera
    T_camera_floor: NDArray[np.float64]
    moves: bool = False
    materials: tuple[tuple[str, ...], ...] = ()


def sample_clip(
    rng: np.random.Generator,
    frames: int = 200,
    fps: float = 15.0,
    people: int = 2,
    width: int = 320,
    progress: Callable[[int], None] | None = None,
    anny: float = 0.0,
    sensor: str | None = None,
    model: str | None = None,
    home: bool = False,
    moves: bool = False,
) -> RoomClip:
    """Make a random video.

    Parameters
    ----------
    rng : numpy.random.Generator
        Same state, same video.
    frames : int
    fps : float
        Frames a second.
    people : int
        Number of people; fewer if the room has no space for their paths.
    width : int
        As for `depth_pose.sim.scenes.sample_scene`.
    progress : callable, optional
        Called with the number of frames done.
    anny : float
        Share of people with a body of Anny, which need the extra ``anny``.
    sensor : str, optional
        Family of the sensor (`depth_pose.sim.scene_noise.FAMILIES`; at home
        `depth_pose.sim.home_sensors.HOME_FAMILIES`); random by default.
    model : str, optional
        Name of the sensor (`depth_pose.sim.sensor.SENSORS`), and of its image, scaled to ``width`` pixels.
    home : bool
        Furnish the room as a home, with pets, and dress people in materials that may return no light.
    moves : bool
        Move the camera: it drives, turns and nods. Without, the same state gives the same home and people,
        seen from where it would begin.
    """
    camera = sample_camera(rng, width) if home else None
    if model is not None:
        camera = SENSORS[model].with_width(width).camera
    view, room = sample_stage(rng, width, camera, UPRIGHT_MOUNTINGS if home else ("common",))
    ways = sample_views(rng, view, room, frames, fps) if home or moves else []
    eyes = np.array([v.position[[0, 2]] for v in ways]) if ways else None
    views = ways if moves else [(ways or [view])[0]] * frames
    cast: list[tuple[Performer, Track]] = []
    for i in range(people):
        performer = Performer(rng, fps, anny)
        track = sample_track(rng, performer, view, room, [t for _, t in cast], frames, i == 0, eyes)
        if track is not None:
            cast.append((performer, track))
    pets = [sample_pet_walk(rng, view, room, frames, fps) for _ in range(rng.integers(3))] if home else []
    room.free = [*([free_points(ways)] if ways else []), *(pet.points() for pet in pets)]
    surfaces = furnish_around(rng, room, view, cast, home)
    if model is not None:
        seen_by = sample_named_sensor(rng, model)
    elif home:
        seen_by = sample_home_sensor(rng, sensor)
    else:
        seen_by = replace(sample_sensor(rng, sensor), far=rng.uniform(6.0, 10.0))
    steady: int | None = int(rng.integers(2**31))
    if moves:
        steady = None  # blotches do not stay in the image
    scenes = []
    worn: tuple[tuple[str, ...], ...] = ()
    for t in range(frames):
        persons = [person_at(p, track, t, home) for p, track in cast]
        around = joined([surfaces, *(pet.surfaces(t) for pet in pets)])
        scene = render(views[t], around, persons, seen_by, rng, steady)
        scenes.append((scene.depth, scene.joints, scene.seen, scene.visible))
        worn = scene.fabrics
        if progress:
            progress(t + 1)
    depth, joints, seen, visible = (np.stack(part) for part in zip(*scenes, strict=True))
    return RoomClip(
        depth,
        joints,
        seen,
        visible,
        START_NS + np.rint(np.arange(frames) * 1e9 / fps).astype(np.int64),
        view.camera,
        np.stack([v.T_camera_room for v in views]) @ upright_from("z"),
        moves,
        worn if home else (),
    )


def sample_still_clip(
    rng: np.random.Generator, frames: int, fps: float, people: int, sensor: str | None = None
) -> RoomClip:
    """Make a random video of a home in which nobody moves: people sit, lie, kneel or stand.

    Parameters
    ----------
    rng : numpy.random.Generator
    frames : int
    fps : float
        Frames a second.
    people : int
        Number of people; fewer if the room has no space for them.
    sensor : str, optional
        Family of the sensor (`depth_pose.sim.home_sensors.HOME_FAMILIES`); random by default.
    """
    home = furnished_home(rng, people=people, sensor=sensor)
    steady = int(rng.integers(2**31))
    scenes = [render(home.view, home.surfaces, home.persons, home.sensor, rng, steady) for _ in range(frames)]
    return RoomClip(
        np.stack([s.depth for s in scenes]),
        np.stack([s.joints for s in scenes]),
        np.stack([s.seen for s in scenes]),
        np.stack([s.visible for s in scenes]),
        START_NS + np.rint(np.arange(frames) * 1e9 / fps).astype(np.int64),
        home.view.camera,
        np.stack([home.view.T_camera_room] * frames) @ upright_from("z"),
        materials=scenes[0].fabrics,
    )


def write_clip(path: Path, clip: RoomClip) -> None:
    """Write a video to ``NAME.mcap`` and its truth to ``NAME.npz`` beside it."""
    c = clip.camera
    with new_file(path.with_suffix(".npz")) as beside, DepthWriter(path, c, FRAME_ID) as writer:
        for stamp, depth in zip(clip.stamps_ns, clip.depth, strict=True):
            writer.write(int(stamp), depth)
        truth: dict[str, NDArray[np.generic]] = {
            "joints": clip.joints,
            "stamps_ns": clip.stamps_ns,
            "names": np.array(JOINTS),
            "K": np.array([[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1.0]]),
            "seen": clip.seen,
            "visible": clip.visible,
        }
        if clip.moves:
            truth["T_camera_floor"] = clip.T_camera_floor
        if clip.materials:
            truth["materials"] = np.array(clip.materials)
        np.savez_compressed(beside, **truth)  # type: ignore[arg-type]
