"""Clips of several people in one room, with the truth, for scoring trackers.

People walk from place to place, cross each other, hide behind furniture and each other, leave the image and
come back, stand side by side, and one may sit down. Room, camera, sensor, builds and clothes stay the same.

The truth beside a recording holds ``joints`` (T, P, 19, 3) float32, optical frame, metres; ``seen``
(T, P, 19); ``visible`` (T, P), share of a person's silhouette that the image shows; ``stamps_ns`` (T,);
``names`` (19,); ``K`` (3, 3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.outputs import new_file
from depth_pose.core.skeleton import JOINTS
from depth_pose.io.mcap_write import DepthWriter
from depth_pose.sim.furniture import make_board, make_chair, make_pillar, make_plant, make_shelf
from depth_pose.sim.performers import Act, Performer, Track
from depth_pose.sim.rooms import Room, furnish, make_room
from depth_pose.sim.scene_noise import sample_sensor
from depth_pose.sim.scene_view import View
from depth_pose.sim.scenes import Placed, place, render, sample_view
from depth_pose.sim.shapes import triangulate
from depth_pose.sim.simulate import FRAME_ID, START_NS

Array = NDArray[np.float64]

_APART_M, _FROM_WALLS_M = 0.5, 0.35
"""Minimum distance of paths from each other and from walls, metres. Set by hand."""
_HIDDEN_S = 2.0
"""Maximum time for which furniture hides a person, seconds. Set by hand."""
_SITS_SHARE = 0.25
"""Probability that a person who may sit down does. Set by hand."""
_TRIES = 40
"""Maximum number of attempts for a path, and for a spot. Set by hand."""
_LOOK_EVERY_S = 0.3  # between the moments at which furniture must not intersect people
_EVERY = 24
"""Stride over a person's vertices in the intersection test with furniture. Set by hand."""


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
    """
    view, room = _stage(rng, width)
    cast: list[tuple[Performer, Track]] = []
    for i in range(people):
        performer = Performer(rng, fps)
        track = _free_track(rng, performer, view, room, [t for _, t in cast], frames, may_sit=i == 0)
        if track is not None:
            cast.append((performer, track))
    every = max(1, round(_LOOK_EVERY_S * fps))
    avoid = [
        np.concatenate([_put(p, track, t).vertices[::_EVERY] for t in range(0, frames, every)])
        for p, track in cast
    ]
    room.ways, room.longest_hidden = [track.spots for _, track in cast], round(_HIDDEN_S * fps)
    _put_seats(rng, room, cast, avoid)
    _put_hiding_places(rng, room, cast, avoid)
    furnish(room, rng, avoid, view, min(room.walls.back, 8.0))
    surfaces, sensor = triangulate(room.shapes, rng), replace(sample_sensor(rng), far=rng.uniform(6.0, 10.0))
    steady = int(rng.integers(2**31))
    scenes = []
    for t in range(frames):
        persons = [_put(p, track, t) for p, track in cast]
        scene = render(view, surfaces, persons, sensor, rng, steady)
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


def _stage(rng: np.random.Generator, width: int) -> tuple[View, Room]:
    """Sample camera and room until people have space to walk and the camera looks along the floor."""
    while True:
        view = sample_view(rng, width, "common")
        tilt = np.rad2deg(np.arcsin(-view.rotation[2, 1]))
        room = make_room(rng, float(view.position[1]))
        w = room.walls
        if not room.studio and min(w.left, w.right) > 1.2 and w.back > 4.0 and -10 < tilt < 30:
            return view, room


def _free_track(
    rng: np.random.Generator,
    performer: Performer,
    view: View,
    room: Room,
    others: Sequence[Track],
    frames: int,
    may_sit: bool,
) -> Track | None:
    """Sample paths through the room until one meets neither walls nor other people; None after many tries."""
    for _ in range(_TRIES):
        acts = _plan(rng, view, room, frames / performer.fps, may_sit)
        start = _spot(rng, view, room)
        track = performer.perform(acts, start, rng.uniform(0, 2 * np.pi), frames)
        clear = min(room.walls.inward(x, z) for x, z in track.spots) > _FROM_WALLS_M
        near = min(np.hypot(*spot) for spot in track.spots) < 0.9
        meets = any(np.linalg.norm(track.spots - o.spots, axis=1).min() < _APART_M for o in others)
        if any(o.seated.any() for o in others):  # no one walks over a reserved seat
            seats = [o.spots[o.seated][0] for o in others if o.seated.any()]
            meets |= any(np.linalg.norm(track.spots - seat, axis=1).min() < 1.1 * _APART_M for seat in seats)
        if clear and not near and not meets:
            return track
    return None


def _plan(rng: np.random.Generator, view: View, room: Room, seconds: float, may_sit: bool) -> list[Act]:
    """Sample acts: walks between spots mostly in view, pauses, and perhaps a seat at the end."""
    acts, spent = [Act("stand", rng.uniform(0.2, 3.0))], 0.0
    while spent < seconds:
        away = rng.random() < 0.25
        acts.append(Act("walk", 8.0, _spot(rng, view, room, outside=away)))
        acts.append(Act("stand", rng.uniform(0.5, 4.0)))
        spent += 5.0
    if may_sit and rng.random() < _SITS_SHARE:
        acts = acts[: int(rng.integers(2, 4))] + [Act("sit", 1e9)]
    return acts


def _spot(rng: np.random.Generator, view: View, room: Room, outside: bool = False) -> tuple[float, float]:
    """Sample a spot on the floor in the camera's view, or one beside it, away from the walls."""
    for _ in range(_TRIES):
        z = rng.uniform(1.3, 5.5)
        edge = z * view.camera.width / (2 * view.camera.fx)
        aside = edge + rng.uniform(0.5, 1.0) if outside else edge * rng.uniform(0.0, 0.85)
        x = float(rng.choice([-1, 1]) * aside)
        if room.walls.inward(x, z) > _FROM_WALLS_M + 0.25:
            return x, float(z)
    return 0.0, 2.0


def _put(performer: Performer, track: Track, t: int) -> Placed:
    figure = performer.figure(track.rotations[t])
    (x, z), turn = track.spots[t], float(track.heading[t])
    return place(figure, float(x), float(z), turn, np.random.default_rng(performer.clothes_seed))


def _put_seats(
    rng: np.random.Generator, room: Room, cast: Sequence[tuple[Performer, Track]], avoid: Sequence[Array]
) -> None:
    """Place a chair where a person will sit."""
    for i, (performer, track) in enumerate(cast):
        if track.seated.any():
            t = int(np.flatnonzero(track.seated)[-1])
            high = performer.figure(track.rotations[t]).seat_height
            (x, z), turn = track.spots[t], float(track.heading[t])
            others = [a for k, a in enumerate(avoid) if k != i]
            room.put(make_chair(rng, high, plain=True), float(x), float(z), turn, others, crowded=0.0)


def _put_hiding_places(
    rng: np.random.Generator, room: Room, cast: Sequence[tuple[Performer, Track]], avoid: Sequence[Array]
) -> None:
    """Place objects between the camera and people's paths."""
    for _, track in cast:
        for _ in range(6):
            x, z = track.spots[int(rng.integers(len(track.spots)))] * rng.uniform(0.5, 0.85)
            maker = (make_pillar, make_shelf, make_board, make_plant)[int(rng.integers(4))]
            turn = np.pi + rng.normal(0, 0.3)
            if room.walls.inward(x, z) > 0.1 and room.put(maker(rng), float(x), float(z), turn, avoid, 0.3):
                break
