"""Paths through a room of what is no person: cameras that drive, turn and nod, and pets that walk.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from depth_pose.core.rotations import rotation_x, rotation_y
from depth_pose.sim.pets import Pet, sample_pet
from depth_pose.sim.rooms import Room
from depth_pose.sim.scene_view import View
from depth_pose.sim.shapes import Assembly, Kind, Triangles, triangulate

Array = NDArray[np.float64]

_AHEAD_M, _ASIDE_M = 1.2, 0.5
"""How far a camera drives ahead and to each side, at most, metres."""
_SPEED_M_S = 0.5
"""Maximum speed of a driving camera, m/s."""
_TURN_DEG, _NOD_DEG = 25.0, 7.0
"""Standard deviations of a camera's yaw and pitch about its first ones, degrees."""
_SHAKE_DEG, _SHAKE_M = 0.15, 0.002
"""Standard deviations of its shaking from frame to frame."""
_SLOW_S = 1.2
"""Time over which its motion is smooth, seconds."""
_FREE_M = 0.3
"""Radius around a camera's path that stays free of furniture, metres."""
_PET_M_S = (0.4, 1.4)
"""Range of speeds of pets."""
_PAUSES = 0.35
"""Share of a pet's legs of a path after which it pauses."""
_FROM_WALLS_M = 0.4
"""Minimum distance of paths from walls, metres."""


def _smooth(rng: np.random.Generator, frames: int, fps: float) -> Array:
    """Sample a smooth function of time (T,) that begins at 0, of deviation about 1."""
    slow = _SLOW_S * fps
    noise = rng.standard_normal(frames + int(8 * slow))
    curve = gaussian_filter1d(noise, slow)[int(4 * slow) :][:frames] * np.sqrt(2 * np.sqrt(np.pi) * slow)
    return np.asarray(curve - curve[0])


def sample_views(rng: np.random.Generator, view: View, room: Room, frames: int, fps: float) -> list[View]:
    """Sample the poses of a camera that drives, turns and nods, one per frame.

    Parameters
    ----------
    rng : numpy.random.Generator
    view : View
        First pose.
    room : Room
        Its walls stop the camera.
    frames : int
    fps : float
        Frames a second.
    """
    way = np.zeros((frames, 2))
    goal = np.array([rng.uniform(-_ASIDE_M, _ASIDE_M), rng.uniform(0.0, _AHEAD_M)])
    if rng.random() < 0.75:  # others only turn
        travel = np.minimum(np.arange(frames) / fps * _SPEED_M_S / max(float(np.hypot(*goal)), 0.1), 1.0)
        share = 0.5 - 0.5 * np.cos(np.pi * travel)
        way = share[:, None] * goal
    way += 0.03 * np.stack([_smooth(rng, frames, fps), _smooth(rng, frames, fps)], axis=1)
    yaw = np.radians(_TURN_DEG) * np.tanh(_smooth(rng, frames, fps))
    pitch = np.radians(_NOD_DEG) * np.tanh(_smooth(rng, frames, fps))
    yaw, pitch = (a + np.radians(_SHAKE_DEG) * rng.standard_normal(frames) for a in (yaw, pitch))
    bob = _SHAKE_M * rng.standard_normal(frames)
    views, at = [], np.zeros(2)
    for t in range(frames):
        if room.walls.inward(*way[t]) > _FROM_WALLS_M:
            at = way[t]
        nod = rotation_x(pitch[t])
        position = view.position + [at[0], bob[t], at[1]]
        views.append(replace(view, rotation=nod @ view.rotation @ rotation_y(yaw[t]).T, position=position))
    return views


def free_points(views: list[View]) -> Array:
    """Return points (N, 3) around the path of a camera that furniture must not reach, room frame."""
    around = np.array([[a, h, b] for a in (-1, 0, 1) for b in (-1, 0, 1) for h in np.linspace(0, 1, 6)])
    spots = np.array([v.position for v in views[:: max(1, len(views) // 40)]])
    reach = np.array([_FREE_M, 1.0, _FREE_M])
    return np.concatenate([s * [1, 0, 1] + around * reach * [1, s[1] + 0.2, 1] for s in spots])


@dataclass(frozen=True)
class PetWalk:
    """A pet that walks through a room.

    Attributes
    ----------
    pet : Pet
    spots : (T, 2) float64
        x and z, metres.
    heading : (T,) float64
        Radians about the vertical, from +z to +x.
    phase : (T,) float64
        Of its gait, cycles.
    posture : tuple of str
        In each frame.
    """

    pet: Pet
    spots: Array
    heading: Array
    phase: Array
    posture: tuple[str, ...]

    def surfaces(self, t: int) -> Triangles:
        """Return its triangles in frame ``t``, room frame."""
        thing = Assembly(Kind.PET)
        own = self.pet.shapes(float(self.phase[t]), self.posture[t])
        thing.add(own, float(self.spots[t, 0]), 0.0, float(self.spots[t, 1]), float(self.heading[t]))
        return triangulate(thing, np.random.default_rng(self.pet.seed))

    def points(self) -> Array:
        """Return points (N, 3) of its path that furniture must not reach, room frame."""
        every = self.spots[:: max(1, len(self.spots) // 40)]
        reach = 0.5 * self.pet.long
        around = np.array([[a, h, b] for a in (-1, 0, 1) for b in (-1, 0, 1) for h in (0.05, 0.5, 1.0)])
        return np.concatenate([[x, 0.0, z] + around * [reach, self.pet.high, reach] for x, z in every])


def sample_pet_walk(rng: np.random.Generator, view: View, room: Room, frames: int, fps: float) -> PetWalk:
    """Sample a pet and its path between spots in view: it walks, stands, sits and lies."""
    pet, pace = sample_pet(rng), rng.uniform(*_PET_M_S)
    at, turn = _spot(rng, view, room), rng.uniform(0, 2 * np.pi)
    spots, heading, posture, phase = [at], [turn], ["stand"], [0.0]
    goal, pause = _spot(rng, view, room), int(rng.uniform(0, 1.0) * fps)
    rest = "stand"
    while len(spots) < frames:
        off = goal - at
        if pause > 0:
            pause -= 1
        elif np.hypot(*off) < 0.15:
            goal = _spot(rng, view, room)
            if rng.random() < _PAUSES:
                pause, rest = int(rng.uniform(0.5, 4.0) * fps), str(rng.choice(["stand", "sit", "lie"]))
        walks = pause == 0
        if walks:
            wanted = np.arctan2(off[0], off[1])
            turn += float(np.clip((wanted - turn + np.pi) % (2 * np.pi) - np.pi, -4.0 / fps, 4.0 / fps))
            step = at + pace / fps * np.array([np.sin(turn), np.cos(turn)])
            if room.walls.inward(*step) > _FROM_WALLS_M:
                at = step
            else:
                goal = _spot(rng, view, room)
        spots.append(at)
        heading.append(turn)
        posture.append("walk" if walks else rest)
        phase.append(phase[-1] + (pace / fps / pet.stride if walks else 0.0))
    return PetWalk(pet, np.array(spots), np.array(heading), np.array(phase), tuple(posture))


def _spot(rng: np.random.Generator, view: View, room: Room) -> Array:
    """Sample a spot on the floor, mostly in view."""
    for _ in range(20):
        x, z = view.floor_spot(rng, rng.uniform(1.2, 4.5), 1.2)
        if room.walls.inward(x, z) > _FROM_WALLS_M + 0.1:
            return np.array([x, z])
    return np.array([0.0, 1.5])
