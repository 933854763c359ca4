"""Simulated people who move, with constant build and clothes.

A performer plays acts one after the other: walk to a spot, stand about with some motion of the embedded
motion source, sit down. Transitions rotate every segment evenly, and the path on
the floor follows from the poses: the lower ankle stays in place, as a foot that carries weight does.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from depth_pose.body.feet import heel_vertices
from depth_pose.core.rotations import rotation_y
from depth_pose.core.skeleton import JOINT_NODES, NODE_INDEX, forward_kinematics
from depth_pose.motion.clip import without_heading
from depth_pose.motion.procedural.generator import make_clip
from depth_pose.sim import _things as things
from depth_pose.sim._builds import draw_build
from depth_pose.sim._dressed_skin import draw_cut, dress
from depth_pose.sim._garments import Wearer
from depth_pose.sim._meshes import join
from depth_pose.sim.people import Figure, draw_seated, draw_worn

Array = NDArray[np.float64]

_STANDING = ("stand_casual", "stand_gesture", "reach_around", "hold_things", "wave", "crossed_arms")
_WALKING = ("walk", "walk", "walk_gesture")
_CLIP_S = 4.0
"""Length of a motion before it begins again, seconds."""
_TURN_RATE = 2.2  # radians a second, for walking around a corner
_THERE_M = 0.25
"""Distance from the goal at which a walk ends, metres."""
_BLEND_S, _SIT_DOWN_S = 0.35, 1.2
"""Duration of the transition between motions, and of sitting down or rising (s)."""
_ANKLES = [NODE_INDEX["left_ankle"], NODE_INDEX["right_ankle"]]
_PELVIS = NODE_INDEX["pelvis"]


@dataclass(frozen=True)
class Act:
    """An act of a performer.

    Attributes
    ----------
    kind : str
        ``walk``, ``stand`` or ``sit``.
    seconds : float
        Duration, including the transition; for a walk the maximum.
    goal : tuple of float, optional
        Spot on the floor that a walk leads to, x and z, metres.
    """

    kind: str
    seconds: float
    goal: tuple[float, float] | None = None


@dataclass(frozen=True)
class Track:
    """Motion of a performer.

    Attributes
    ----------
    rotations : (T, 21, 3, 3) float64
        Facing +z.
    heading : (T,) float64
        Radians about the vertical, from +z to +x.
    spots : (T, 2) float64
        Position of the pelvis on the floor, x and z, metres.
    seated : (T,) bool
        Whether the person sits still on their seat.
    acts : (T,) int64
        Index of the act that is played.
    """

    rotations: Array
    heading: Array
    spots: Array
    seated: NDArray[np.bool_]
    acts: NDArray[np.int64]

    def before(self, act: int) -> Track:
        """Return the motion before an act begins."""
        n = int(np.searchsorted(self.acts, act))
        return Track(self.rotations[:n], self.heading[:n], self.spots[:n], self.seated[:n], self.acts[:n])

    def at(self, frames: Array) -> Track:
        """Return the motion at moments (N,) between its frames, in units of frames from the first.

        Segments rotate evenly from frame to frame; moments after the last frame get the last.
        """
        last = len(self.spots) - 1
        before = np.minimum(frames, last).astype(np.int64)
        after = np.minimum(before + 1, last)
        share = np.minimum(frames, last) - before
        steps = zip(self.rotations[before], self.rotations[after], share, strict=True)
        return Track(
            np.stack([_turned(one, other, s) for one, other, s in steps]),
            (1 - share) * self.heading[before] + share * self.heading[after],
            (1 - share)[:, None] * self.spots[before] + share[:, None] * self.spots[after],
            self.seated[before],
            self.acts[before],
        )


class Performer:
    """A person of one build in one outfit.

    Parameters
    ----------
    rng : numpy.random.Generator
        Random numbers for build, outfit and habits.
    fps : float
        Frame rate of the motion.
    anny : float
        Share of bodies of Anny.
    """

    def __init__(self, rng: np.random.Generator, fps: float, anny: float = 0.0) -> None:
        self.fps = fps
        self._build = draw_build(rng, anny=anny)
        self._cut = draw_cut(rng, self._build)
        self._outfit, self.clothes_seed = (int(n) for n in rng.integers(2**62, size=2))
        self._clips = {
            "walk": self._clip(rng, str(rng.choice(_WALKING))),
            "stand": self._clip(rng, str(rng.choice(_STANDING))),
            "sit": draw_seated(rng)[None],
        }

    def _clip(self, rng: np.random.Generator, name: str) -> Array:
        return without_heading(make_clip(name, self.fps, _CLIP_S, int(rng.integers(2**31))).rotations)

    def perform(
        self,
        acts: Sequence[Act],
        spot: tuple[float, float],
        heading: float,
        frames: int,
        done: Track | None = None,
    ) -> Track:
        """Play acts from a spot on the floor; the last continues to the end.

        Parameters
        ----------
        acts : sequence of Act
        spot : tuple of float
            x and z, metres.
        heading : float
            Radians, as in `Track`.
        frames : int
        done : Track, optional
            Motion of the first acts, performed before with different later acts.
        """
        rotations, headings, spots = np.empty((frames, 21, 3, 3)), np.empty(frames), np.empty((frames, 2))
        seated, played = np.zeros(frames, bool), np.empty(frames, np.int64)
        at, ankles, first = np.array(spot, float), None, 0
        act, queue, since, phase = acts[0], list(acts[1:]), 0.0, 0
        blend = _Blend(None, 0.0)
        if done is not None and len(done.acts):
            first, last = len(done.acts), int(done.acts[-1])
            act, queue, since = acts[last], list(acts[last + 1 :]), np.inf  # so that the next act begins
            rotations[:first], headings[:first], spots[:first] = done.rotations, done.heading, done.spots
            seated[:first], played[:first] = done.seated, done.acts
            at, heading = spots[first - 1], headings[first - 1]
            ankles = self._ankles(rotations[first - 1], heading)
        for t in range(first, frames):
            if queue and self._is_over(act, since, at):
                sits = "sit" in (act.kind, queue[0].kind)
                act, since, phase = queue.pop(0), 0, 0
                blend = _Blend(rotations[t - 1], (_SIT_DOWN_S if sits else _BLEND_S) * self.fps)
            elif act.kind == "walk" and phase == len(self._clips["walk"]):
                phase, blend = 0, _Blend(rotations[t - 1], _BLEND_S * self.fps)
            pose = blend.toward(_frame(self._clips[act.kind], phase), phase)
            if act.goal is not None:
                heading = _steer(heading, np.array(act.goal) - at, _TURN_RATE / self.fps)
            stands = self._ankles(pose, heading)
            if ankles is not None:
                low = int(np.argmin(stands[:, 1]))
                at = at + ankles[low, [0, 2]] - stands[low, [0, 2]]
            ankles = stands
            rotations[t], headings[t], spots[t] = pose, heading, at
            seated[t] = act.kind == "sit" and since >= self.fps * _SIT_DOWN_S
            played[t] = len(acts) - 1 - len(queue)
            since, phase = since + 1, phase + 1
        return Track(rotations, headings, spots, seated, played)

    def _ankles(self, pose: Array, heading: float) -> Array:
        """Return the ankles (2, 3) of a pose, relative to the pelvis, metres."""
        turned = rotation_y(np.array(heading)) @ pose
        return forward_kinematics(turned, np.zeros(3), self._build.body.nodes)[_ANKLES]

    def _is_over(self, act: Act, since: float, at: Array) -> bool:
        there = act.goal is not None and np.hypot(*(np.array(act.goal) - at)) < _THERE_M
        return bool(there or since >= act.seconds * self.fps)

    def figure(self, rotations: Array) -> Figure:
        """Dress the person in a pose (21, 3, 3) that faces +z; stands on the floor at the origin."""
        body = self._build.body
        rng = np.random.default_rng(self._outfit)  # the same folds, hair and bags each time
        posed = body.pose(rotations, np.zeros(3))
        skin = dress(rng, posed.vertices, self._build, self._cut)
        rise = -float(skin[:, 1].min())
        skin[:, 1] += rise
        nodes = posed.nodes + [0.0, rise, 0.0]
        wearer = Wearer(skin, nodes, rotations, body.weights, body.stature, 0.0)
        worn = draw_worn(rng, wearer, "stand", self._build.woman)
        vertices, faces = join([(skin, body.faces), *worn])
        held_vertices, held_faces = join(things.belongings(rng, wearer, "free"))
        return Figure(
            vertices.astype(np.float32),
            faces,
            nodes[JOINT_NODES].astype(np.float32),
            skin[heel_vertices(body)].astype(np.float32),
            held_vertices.astype(np.float32),
            held_faces,
            "stand",
            float(skin[body.weights[:, _PELVIS] > 0.5, 1].min()),
            body.stature,
        )


@dataclass(frozen=True)
class _Blend:
    """A pose that is blended out over some frames; None for none."""

    before: Array | None
    frames: float

    def toward(self, pose: Array, since: int) -> Array:
        if self.before is None or since >= self.frames:
            return pose
        return _between(self.before, pose, since / self.frames)


def _frame(clip: Array, phase: int) -> Array:
    """Pose of a clip that plays to and fro."""
    n = len(clip)
    phase %= max(2 * n - 2, 1)
    return clip[phase if phase < n else 2 * n - 2 - phase]


def _between(one: Array, other: Array, share: float) -> Array:
    """Rotate each segment evenly from one pose to another, slowly at both ends."""
    return _turned(one, other, share * share * (3 - 2 * share))


def _turned(one: Array, other: Array, share: float) -> Array:
    """Rotate each segment a share of the way from one pose to another."""
    step = Rotation.from_matrix(np.swapaxes(one, 1, 2) @ other).as_rotvec()
    return np.asarray(one @ Rotation.from_rotvec(share * step).as_matrix())


def _steer(heading: float, way: Array, most: float) -> float:
    wanted = np.arctan2(way[0], way[1])
    off = (wanted - heading + np.pi) % (2 * np.pi) - np.pi
    return heading + float(np.clip(off, -most, most))
