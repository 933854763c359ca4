"""People who act in a furnished room: where they walk, and the furniture around their paths.

The room frame is that of `depth_pose.sim.scene_view`: camera 0 stands above the origin, y up, z along its
view. Paths meet neither walls nor other people. `sample_track` samples whole paths until one is free of
conflicts, which suffices for some seconds; `sample_long_track` replaces only the acts that lead to a
conflict, so that paths of minutes are found.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.sim.furniture import make_board, make_chair, make_pillar, make_plant, make_shelf
from depth_pose.sim.homes import furnish_home
from depth_pose.sim.materials import sample_wardrobe
from depth_pose.sim.performers import Act, Performer, Track
from depth_pose.sim.placed import Placed, place
from depth_pose.sim.rooms import Room, furnish, make_room
from depth_pose.sim.scene_view import View
from depth_pose.sim.scenes import mount, sample_view
from depth_pose.sim.shapes import Triangles, triangulate

Array = NDArray[np.float64]
Cast = Sequence[tuple[Performer, Track]]
"""The people of a video and their motion."""

_APART_M, _FROM_WALLS_M = 0.5, 0.35
"""Minimum distance of paths from each other and from walls, metres."""
_FROM_CAMERA_M = 0.9
"""Minimum distance of paths from camera 0, metres."""
_HIDDEN_S, _HIDDEN_AT_HOME_S = 2.0, 0.5
"""Maximum time for which a piece of furniture hides a person, in rooms and in homes with more of them,
seconds."""
_SITS_SHARE = 0.25
"""Probability that a person who may sit down does."""
_TRIES = 40
"""Maximum number of attempts for a path, and for a spot."""
_LONG_TRIES = 300
"""Maximum number of corrections of a long path."""
_AHEAD_S = 8.0
"""Length by which a long path grows before it is checked again, seconds."""
_LOOK_EVERY_S = 0.3  # between the moments at which furniture must not intersect people
_EVERY = 24
"""Stride over a person's vertices in the intersection test with furniture."""


def sample_stage(
    rng: np.random.Generator, width: int, camera: Camera | None = None, mountings: Sequence[str] = ("common",)
) -> tuple[View, Room]:
    """Sample camera and room until people have space to walk and the camera looks along the floor.

    Parameters
    ----------
    rng : numpy.random.Generator
    width : int
        As for `depth_pose.sim.scenes.sample_scene`.
    camera : Camera, optional
        Intrinsics; random by default.
    mountings : sequence of str
        One of these is drawn for a given camera (`depth_pose.sim.scenes.mount`).
    """
    while True:
        if camera is None:
            view = sample_view(rng, width, "common")
        else:
            view = mount(rng, camera, str(rng.choice(mountings)))
        tilt = np.rad2deg(np.arcsin(-view.rotation[2, 1]))
        room = make_room(rng, float(view.position[1]))
        w = room.walls
        if not room.studio and min(w.left, w.right) > 1.2 and w.back > 4.0 and -10 < tilt < 30:
            return view, room


def sample_track(
    rng: np.random.Generator,
    performer: Performer,
    view: View,
    room: Room,
    others: Sequence[Track],
    frames: int,
    may_sit: bool,
    eyes: Array | None = None,
) -> Track | None:
    """Sample paths through the room until one has no conflict; None after many tries.

    ``eyes`` (T, 2) are the spots of a camera that moves, x and z; the origin by default.
    """
    for _ in range(_TRIES):
        acts = _plan(rng, view, room, frames / performer.fps, may_sit)
        start = _spot(rng, view, room)
        track = performer.perform(acts, start, rng.uniform(0, 2 * np.pi), frames)
        if not _conflicts(track, room, others, eyes).any():
            return track
    return None


def sample_long_track(
    rng: np.random.Generator,
    performer: Performer,
    view: View,
    room: Room,
    others: Sequence[Track],
    frames: int,
    may_sit: bool,
) -> Track | None:
    """Sample a path through the room, replacing acts that lead to a conflict; None after many tries.

    Parameters are those of `sample_track`.
    """
    step = round(_AHEAD_S * performer.fps)
    acts: list[Act] = []
    start, heading, length, done = (0.0, 0.0), 0.0, step, None
    for _ in range(_LONG_TRIES):
        if not acts:
            acts = _plan(rng, view, room, frames / performer.fps, may_sit)
            start, heading, length = _spot(rng, view, room), rng.uniform(0, 2 * np.pi), step
        track = performer.perform(acts, start, heading, min(length, frames), done)
        wrong = np.flatnonzero(_conflicts(track, room, others))
        if not len(wrong) and length >= frames:
            return track
        kept = int(track.acts[-1])
        if len(wrong):
            kept = max(int(track.acts[wrong[0]]) - int(rng.integers(0, 3)), 0)
            acts = acts[:kept]
            acts += _plan(rng, view, room, frames / performer.fps, may_sit) if acts else []
        else:
            length += step
        done = track.before(kept)
    return None


def _conflicts(
    track: Track, room: Room, others: Sequence[Track], eyes: Array | None = None
) -> NDArray[np.bool_]:
    """Return at which frames (T,) a person is too close to a wall, to camera 0 or to another person."""
    bad = np.array([room.walls.inward(x, z) <= _FROM_WALLS_M for x, z in track.spots])
    from_camera = track.spots if eyes is None else track.spots - eyes[: len(bad)]
    bad |= np.hypot(*from_camera.T) < _FROM_CAMERA_M
    for other in others:
        bad |= np.linalg.norm(track.spots - other.spots[: len(bad)], axis=1) < _APART_M
        if other.seated.any():  # no one walks over a reserved seat
            seat = other.spots[other.seated][0]
            bad |= np.linalg.norm(track.spots - seat, axis=1) < 1.1 * _APART_M
    return bad


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


def person_at(performer: Performer, track: Track, t: int, home: bool = False) -> Placed:
    """Place a person as they are in frame ``t`` of their motion; at home in clothes of known materials."""
    figure = performer.figure(track.rotations[t])
    (x, z), turn = track.spots[t], float(track.heading[t])
    rng = np.random.default_rng(performer.clothes_seed)
    wardrobe = sample_wardrobe(rng) if home else None
    return place(figure, float(x), float(z), turn, rng, wardrobe)


def furnish_around(
    rng: np.random.Generator, room: Room, view: View, cast: Cast, home: bool = False
) -> Triangles:
    """Furnish a room so that nothing intersects people or hides them from camera 0 for long.

    Parameters
    ----------
    rng : numpy.random.Generator
    room : Room
        Receives the furniture.
    view : View
        Camera 0; most furniture stands in its view.
    cast : sequence of (Performer, Track)
    home : bool
        Whether the furniture is that of a home.

    Returns
    -------
    Triangles
        All surfaces of the room, room frame.
    """
    fps = cast[0][0].fps if cast else 1.0
    every = max(1, round(_LOOK_EVERY_S * fps))
    avoid = [
        np.concatenate([person_at(p, track, t).vertices[::_EVERY] for t in range(0, len(track.spots), every)])
        for p, track in cast
    ]
    room.ways = [track.spots for _, track in cast]
    room.longest_hidden = round((_HIDDEN_AT_HOME_S if home else _HIDDEN_S) * fps)
    _put_seats(rng, room, cast, avoid)
    _put_hiding_places(rng, room, cast, avoid)
    (furnish_home if home else furnish)(room, rng, avoid, view, min(room.walls.back, 8.0))
    return triangulate(room.shapes, rng)


def _put_seats(rng: np.random.Generator, room: Room, cast: Cast, avoid: Sequence[Array]) -> None:
    """Place a chair where a person will sit."""
    for i, (performer, track) in enumerate(cast):
        if track.seated.any():
            t = int(np.flatnonzero(track.seated)[-1])
            high = performer.figure(track.rotations[t]).seat_height
            (x, z), turn = track.spots[t], float(track.heading[t])
            others = [a for k, a in enumerate(avoid) if k != i]
            room.put(make_chair(rng, high, plain=True), float(x), float(z), turn, others, crowded=0.0)


def _put_hiding_places(rng: np.random.Generator, room: Room, cast: Cast, avoid: Sequence[Array]) -> None:
    """Place objects between the camera and people's paths."""
    for _, track in cast:
        for _ in range(6):
            x, z = track.spots[int(rng.integers(len(track.spots)))] * rng.uniform(0.5, 0.85)
            maker = (make_pillar, make_shelf, make_board, make_plant)[int(rng.integers(4))]
            turn = np.pi + rng.normal(0, 0.3)
            if room.walls.inward(x, z) > 0.1 and room.put(maker(rng), float(x), float(z), turn, avoid, 0.3):
                break
