"""Simulated close-ups of people: only the part of an image that the joint net crops is drawn.

A person with furniture around them, and several cameras anywhere around and above. What a whole room would
add lies outside the crop, so this takes a tenth of the time of `depth_pose.sim.scenes` per person, and its
cameras also hang where rooms of that module have none: under ceilings, straight above, rolled.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.sim import _scene_kernels as kernels
from depth_pose.sim.crowds import Casting
from depth_pose.sim.furniture import AT_WALLS, STANDING
from depth_pose.sim.home_scenes import AT_HOME, CHILD_M, CHILDREN, HOLDING, WRAPPED
from depth_pose.sim.home_sensors import sample_home_sensor
from depth_pose.sim.homes import HIDING, HOME_AT_WALLS, HOME_STANDING, dark_or_not
from depth_pose.sim.people import HOLDS_M, sample_figure
from depth_pose.sim.placed import Placed
from depth_pose.sim.resting import Settled, child_in_arms
from depth_pose.sim.rooms import draw_thing
from depth_pose.sim.scene_noise import SceneSensor, Shown, measure, sample_sensor
from depth_pose.sim.scene_view import View
from depth_pose.sim.shapes import Assembly, Kind, Triangles, triangulate

Array = NDArray[np.float64]

POSTURES = {
    "stand": 0.23, "walk": 0.13, "sit": 0.22, "lie": 0.09, "kneel": 0.06,
    "squat": 0.05, "crawl": 0.03, "bend": 0.07, "reach": 0.08, "lean": 0.04,
}  # fmt: skip
"""Frequency of each posture: rare ones are drawn more often than in rooms. Set by hand."""

REACH_M = 1.6
"""Half of the side of the area drawn around a torso, metres: the crop, rotated and displaced. Set by hand."""

_TORSO = [JOINT_INDEX[f"{side}_{n}"] for side in ("left", "right") for n in ("shoulder", "hip")]
_LEAST_PIXELS, _LEAST_SHOWN = 60, 0.3
"""People with fewer pixels, or with a smaller visible share, are not used. Set by hand."""
_COMMON_SHARE = 0.55
_ABOVE_SHARE = 0.5
"""Share of cameras in the usual arrangement: 2 to 4.6 m away, upright, with the person in the middle; and of
the others, those that look down from under a ceiling. Set by hand."""
_TRIES = 2
"""Number of cameras tried for each that is wanted. Set by hand."""
_BLOCK = 32
"""Sides of drawn images are multiples of this many pixels, where the image has room."""
_HIDDEN_SHARE = 0.5
"""Share of people at home with something before them. Set by hand."""
_FARTHEST_M = {False: 4.6, True: 6.0}
"""Largest distance of cameras in the usual arrangement (m), in rooms and at home. Set by hand."""
_NEAR_M = 0.05
_OTHERS = 12
"""Number of figures kept for placing beside later ones."""


@dataclass(frozen=True)
class CloseUp:
    """Part of a depth image with one person in its middle.

    Attributes
    ----------
    depth : (h, w) uint16
        As measured, millimetres; 0 where nothing returned.
    whose : (h, w) uint8
        1 where the image shows the person, 2 for others, 0 for things; also where nothing returned.
    camera : Camera
        Camera of this part.
    landmarks : (21, 3) float32
        `depth_pose.core.skeleton.LANDMARKS`, optical frame, metres.
    """

    depth: NDArray[np.uint16]
    whose: NDArray[np.uint8]
    camera: Camera
    landmarks: NDArray[np.float32]


@dataclass
class CloseUpMaker:
    """Generator of close-ups, several of each person.

    Attributes
    ----------
    views : int
        Number of cameras that look at each person.
    anny : float
        Share of people with a body of Anny.
    homes : float
        Share of people as they are at home: dark clothes, pets, cloth and furniture before them.
    stereo : float
        Share of sensors at home that are stereo cameras, half of them with a projector.
    """

    views: int = 4
    anny: float = 0.0
    homes: float = 0.5
    stereo: float = 0.5
    _others: list[Settled] = field(default_factory=list)

    def make(self, rng: np.random.Generator) -> list[CloseUp]:
        """Sample a person, their surroundings and some cameras; return the views that show enough of them.

        It may be fewer than wanted, or none.
        """
        names = list(POSTURES)
        shares = np.array(list(POSTURES.values()))
        posture = names[rng.choice(len(names), p=shares / shares.sum())]
        home = bool(rng.random() < self.homes)
        casting = AT_HOME if home else Casting()
        doing, tallest, wrapped = _habits(rng, posture) if home else (None, np.inf, 1.0)
        figure = sample_figure(rng, posture, True, doing, tallest, self.anny, wrapped)
        settled = casting.settle(figure, rng, None)
        person = casting.place(settled.figure, (0.0, 0.0, 0.0), rng)
        shapes = Assembly(Kind.WALL)
        for thing in settled.things:
            shapes.add(thing)
        beside = self._beside(settled, person, shapes, casting, rng)
        surroundings = _surround(shapes, person, beside, home, rng)
        room = triangulate(surroundings.shapes, rng)
        self._others = [*self._others[-_OTHERS:], settled]
        out = []
        torso = person.joints[_TORSO].mean(axis=0)
        for _ in range(_TRIES * self.views):
            view = _sample_view(torso, surroundings, _FARTHEST_M[home], rng)
            seen = None
            if view is not None:
                sensor = self._home_sensor(rng) if home else sample_sensor(rng)
                seen = _render(view, sensor, person, beside, room, rng)
            if seen is not None:
                out.append(seen)
            if len(out) == self.views:
                break
        return out

    def _home_sensor(self, rng: np.random.Generator) -> SceneSensor:
        pair = ("active", "passive") if rng.random() < self.stereo else ("structured", "tof")
        return sample_home_sensor(rng, str(rng.choice(pair)))

    def _beside(
        self,
        settled: Settled,
        person: Placed,
        shapes: Assembly,
        casting: Casting,
        rng: np.random.Generator,
    ) -> list[Placed]:
        """Place a child in the person's arms, and earlier figures at the same table or beside the person."""
        child = child_in_arms(settled.figure, rng)
        around = [] if child is None else [casting.place(child, (0.0, 0.0, 0.0), rng)]
        others, spots = self._others, []
        if settled.table > 0:
            others = [o for o in others if o.figure.posture == "sit" and o.figure.seat_height > 0]
            across = 2 * settled.table
            at = ((0.0, across, np.pi), (0.7, across, np.pi), (0.7, 0.0, 0.0), (-0.7, 0.0, 0.0))
            spots = [spot for spot in at if rng.random() < 0.35]
        elif rng.random() < 0.25:
            angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(0.4, 1.3)
            spots = [(away * np.sin(angle), away * np.cos(angle), rng.uniform(0, 2 * np.pi))]
        for x, z, turn in spots if others else []:
            other, turned = others[int(rng.integers(len(others)))], turn + rng.normal(0, 0.1)
            placed = casting.place(other.figure, (x, z, turned), rng)
            apart = np.linalg.norm(person.joints[:, None] - placed.joints[None], axis=-1)
            rests = other.things[:1]  # not their table
            if apart.min() > 0.2 and all(_put(shapes, t, x, z, turned, person.vertices[::10]) for t in rests):
                around.append(placed)
        return around


@dataclass(frozen=True)
class _Surroundings:
    """Objects around a person, and the angle and distance of walls that cameras must not be behind."""

    shapes: Assembly
    walls: tuple[tuple[float, float], ...]


def _habits(rng: np.random.Generator, posture: str) -> tuple[str | None, float, float]:
    """Sample what a person at home holds up, their maximum stature (m), and how wrapped they are."""
    holds = posture == "stand" and rng.random() < HOLDING
    tallest = CHILD_M if rng.random() < CHILDREN else np.inf
    return str(rng.choice(list(HOLDS_M))) if holds else None, tallest, WRAPPED


def _surround(
    shapes: Assembly, person: Placed, beside: list[Placed], home: bool, rng: np.random.Generator
) -> _Surroundings:
    """Place floor, walls, furniture and supports around a person at the origin who faces +z."""
    walls: list[tuple[float, float]] = []
    if rng.random() < 0.12:  # nothing but the person
        return _Surroundings(shapes, ())
    shapes.box((0, -0.01, 0), (30.0, 0.02, 30.0), 0, 0, Kind.FLOOR, rng.uniform(0.05, 0.8))
    reach = float(np.abs(person.vertices[:, [0, 2]]).max())
    turn = rng.uniform(0, 2 * np.pi)
    for k, share in enumerate((0.7, 0.3)):
        if rng.random() < share:
            angle, away = (
                turn + k * np.pi / 2,
                reach + rng.choice([rng.uniform(0.05, 0.8), rng.uniform(0.5, 3.0)]),
            )
            at = (away * np.sin(angle), 1.4, away * np.cos(angle))
            shapes.box(at, (20.0, 2.8, 0.02), angle, 0.0, Kind.WALL, rng.uniform(0.2, 0.9))
            walls.append((angle, away))
    points = np.concatenate([p.vertices[::10] for p in (person, *beside)])
    for _ in range(int(rng.poisson(rng.choice([0.5, 2.0, 5.0])))):
        standing, at_walls = (HOME_STANDING, HOME_AT_WALLS) if home else (STANDING, AT_WALLS)
        thing = draw_thing(rng, standing if rng.random() < 0.7 else at_walls)
        if home:
            thing = dark_or_not(thing, rng)
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 2.2)
        _put(shapes, thing, away * np.sin(angle), away * np.cos(angle), rng.uniform(0, 2 * np.pi), points)
    if home and rng.random() < _HIDDEN_SHARE:  # before the person, for cameras in the usual arrangement
        thing, angle = dark_or_not(draw_thing(rng, HIDING), rng), rng.normal(0, 0.8)
        low, high = thing.bounds()
        away = reach * rng.uniform(0.3, 1.0) + 0.5 * float(high[2] - low[2]) + rng.uniform(0.05, 0.8)
        turn = angle + rng.normal(0, 0.4)
        _put(shapes, thing, away * np.sin(angle), away * np.cos(angle), turn, points)
    return _Surroundings(shapes, tuple(walls))


def _put(shapes: Assembly, thing: Assembly, x: float, z: float, turn: float, points: Array) -> bool:
    """Place an object unless it would intersect a person; return whether it was placed."""
    low, high = thing.bounds()
    c, s = np.cos(turn), np.sin(turn)
    dx, dz = points[:, 0] - x, points[:, 2] - z
    own = np.stack([c * dx - s * dz, points[:, 1], s * dx + c * dz], axis=1)
    if np.any(np.all((own > low) & (own < high), axis=1)):
        return False
    shapes.add(thing, x, 0.0, z, turn)
    return True


def _sample_view(
    torso: Array, around: _Surroundings, farthest: float, rng: np.random.Generator
) -> View | None:
    """Sample a camera that looks roughly at a torso; None if it is behind a wall."""
    width = int(rng.choice([160, 176, 176, 212, 224, 256, 320]))
    height = min(
        240, round(width / float(rng.choice([4 / 3, 11 / 9, 16 / 9, 1.0], p=[0.55, 0.2, 0.15, 0.1])))
    )
    spread = rng.normal(57, 6) if rng.random() < 0.5 else rng.uniform(40, 95)
    focal = width / 2 / np.tan(np.radians(np.clip(spread, 38, 100)) / 2)
    azimuth = rng.normal(0, 0.8) if rng.random() < 0.5 else rng.uniform(-np.pi, np.pi)
    common = rng.random() < _COMMON_SHARE
    away = rng.uniform(1.9, farthest) if common else float(np.clip(np.exp(rng.normal(0.9, 0.6)), 0.55, 6.5))
    above = not common and rng.random() < _ABOVE_SHARE
    lift = rng.uniform(1.9, 4.0) if above else float(np.clip(rng.normal(1.3, 0.5), 0.25, 3.0))
    flat = rng.uniform(0.0, 2.2) if above else np.sqrt(max(away**2 - (lift - torso[1]) ** 2, 0.2))
    at = np.array([torso[0] + flat * np.sin(azimuth), lift, torso[2] + flat * np.cos(azimuth)])
    if any(np.sin(a) * at[0] + np.cos(a) * at[2] > d - 0.1 for a, d in around.walls):
        return None
    forward = torso - at
    distance = float(np.linalg.norm(forward))
    if distance < 0.5:
        return None
    aside = rng.normal(0, 0.1, 2) if common else rng.uniform(-0.45, 0.45, 2)
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    odd = rng.choice([90.0, -90.0, 180.0, rng.uniform(-180, 180)]) if rng.random() < 0.15 else 0.0
    roll = rng.normal(0, 4) + (0.0 if common else odd)
    turned = _look_at(forward / distance, np.radians(roll))
    # the torso appears at some place of the image, not in its middle
    off = np.array([aside[0] * width / focal, aside[1] * height / focal, 1.0])
    return View(camera, _between(off / np.linalg.norm(off)) @ turned, at)


def _look_at(forward: Array, roll: float) -> Array:
    """Rotation (3, 3) to the optical frame of a camera that looks along ``forward``."""
    up = np.array([0.0, 1.0, 0.0]) if abs(forward[1]) < 0.98 else np.array([0.0, 0.0, 1.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    return np.stack([c * right + s * down, c * down - s * right, forward])


def _between(target: Array) -> Array:
    """Rotation (3, 3) that takes the optical axis to a direction."""
    axis = np.cross([0.0, 0.0, 1.0], target)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + k + k @ k / (1.0 + target[2]))


def _render(
    view: View,
    sensor: SceneSensor,
    person: Placed,
    beside: list[Placed],
    room: Triangles,
    rng: np.random.Generator,
) -> CloseUp | None:
    """Render a camera's depth image around a person; None where it shows too little of them."""
    joints = view.to_optical(person.joints)
    torso = joints[_TORSO].mean(axis=0)
    if torso[2] < 0.4 or (joints[:, 2] < 0.05).sum() > 6:
        return None
    camera = _part(view.camera, torso)
    if camera is None:
        return None
    shape = (camera.height, camera.width)
    inverse, face = np.zeros(shape), np.full(shape, -1, np.int32)
    own = view.to_optical(person.vertices)
    kernels.raster(own, person.faces, camera, _NEAR_M, inverse, face)
    alone = int((face >= 0).sum())
    if alone < _LEAST_PIXELS:
        return None
    parts = [(own, person.faces), (view.to_optical(person.held_vertices), person.held_faces)]
    albedos = [person.albedo, np.full(len(person.held_faces), person.held_albedo, np.float32)]
    owners = [np.ones(len(person.faces), np.uint8), np.zeros(len(person.held_faces), np.uint8)]
    for other in beside:
        parts.append((view.to_optical(other.vertices), other.faces))
        albedos.append(other.albedo)
        owners.append(np.full(len(other.faces), 2, np.uint8))
    parts.append((view.to_optical(room.vertices), room.faces))
    albedos.append(room.albedo)
    owners.append(np.zeros(len(room.faces), np.uint8))
    starts = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
    vertices = np.concatenate([v for v, _ in parts])
    faces = np.concatenate([f + n for (_, f), n in zip(parts, starts, strict=True)])
    rest = np.full(shape, -1, np.int32)  # what lies before the person, drawn already
    kernels.raster(vertices, faces[len(person.faces) :], camera, _NEAR_M, inverse, rest)
    face = np.where(rest >= 0, rest + len(person.faces), face)
    whose = np.append(np.concatenate(owners), np.uint8(0))[face]
    shown = int((whose == 1).sum())
    if shown < max(_LEAST_PIXELS, _LEAST_SHOWN * alone):
        return None
    cosine = np.zeros(shape, np.float32)
    kernels.shade(vertices, faces, face, camera, cosine)
    albedo = np.append(np.concatenate(albedos), np.float32(0))[face]
    depth = np.divide(1.0, inverse, out=np.zeros(shape), where=face >= 0).astype(np.float32)
    measured = measure(Shown(depth, cosine, albedo, camera.fx), sensor, rng)
    if int(((whose == 1) & (measured > 0)).sum()) < _LEAST_PIXELS:
        return None
    landmarks = np.concatenate([joints, view.to_optical(person.heels)]).astype(np.float32)
    return CloseUp(np.rint(measured * 1000).astype(np.uint16), whose, camera, landmarks)


def _part(camera: Camera, torso: Array) -> Camera | None:
    """Return the camera of the image part around a torso; None where the image does not contain it."""
    u = camera.fx * torso[0] / torso[2] + camera.cx
    v = camera.fy * torso[1] / torso[2] + camera.cy
    reach = REACH_M * camera.fx / torso[2]
    spans = []
    for middle, size in ((u, camera.width), (v, camera.height)):
        first, last = max(0, int(middle - reach)), min(size, int(middle + reach) + 1)
        if last - first < 16:
            return None
        last = min(size, first + -(-(last - first) // _BLOCK) * _BLOCK)
        spans.append((first, last))
    (left, right), (top, bottom) = spans
    return camera._replace(width=right - left, height=bottom - top, cx=camera.cx - left, cy=camera.cy - top)
