"""Clips of several people in one room, with the truth, for scoring trackers.

People walk from place to place, cross each other, hide behind furniture and each other, leave the image and
come back, stand side by side, and one may sit down. Room, camera, sensor, builds and clothes stay the same.

The truth beside a recording holds ``joints`` (T, P, 19, 3) float32, optical frame, metres; ``seen``
(T, P, 19); ``visible`` (T, P), share of a person's silhouette that the image shows; ``stamps_ns`` (T,);
``names`` (19,); ``K`` (3, 3).
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
from depth_pose.sim.performers import Performer, Track
from depth_pose.sim.play import furnish_around, person_at, sample_stage, sample_track
from depth_pose.sim.scene_noise import sample_sensor
from depth_pose.sim.scenes import render
from depth_pose.sim.simulate import FRAME_ID, START_NS


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
    """

    depth: NDArray[np.float32]
    joints: NDArray[np.float32]
    seen: NDArray[np.bool_]
    visible: NDArray[np.float32]
    stamps_ns: NDArray[np.int64]
    camera: Camera


def sample_clip(
    rng: np.random.Generator,
    frames: int = 200,
    fps: float = 15.0,
    people: int = 2,
    width: int = 320,
    progress: Callable[[int], None] | None = None,
    anny: float = 0.0,
    sensor: str | None = None,
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
        Family of the sensor (`depth_pose.sim.scene_noise.FAMILIES`); random by default.
    """
    view, room = sample_stage(rng, width)
    cast: list[tuple[Performer, Track]] = []
    for i in range(people):
        performer = Performer(rng, fps, anny)
        track = sample_track(rng, performer, view, room, [t for _, t in cast], frames, may_sit=i == 0)
        if track is not None:
            cast.append((performer, track))
    surfaces = furnish_around(rng, room, view, cast)
    seen_by = replace(sample_sensor(rng, sensor), far=rng.uniform(6.0, 10.0))
    steady = int(rng.integers(2**31))
    scenes = []
    for t in range(frames):
        persons = [person_at(p, track, t) for p, track in cast]
        scene = render(view, surfaces, persons, seen_by, rng, steady)
        scenes.append((scene.depth, scene.joints, scene.seen, scene.visible))
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
    )


def write_clip(path: Path, clip: RoomClip) -> None:
    """Write a video to ``NAME.mcap`` and its truth to ``NAME.npz`` beside it."""
    c = clip.camera
    with new_file(path.with_suffix(".npz")) as beside, DepthWriter(path, c, FRAME_ID) as writer:
        for stamp, depth in zip(clip.stamps_ns, clip.depth, strict=True):
            writer.write(int(stamp), depth)
        np.savez_compressed(
            beside,
            joints=clip.joints,
            stamps_ns=clip.stamps_ns,
            names=np.array(JOINTS),
            K=np.array([[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1.0]]),
            seen=clip.seen,
            visible=clip.visible,
        )
