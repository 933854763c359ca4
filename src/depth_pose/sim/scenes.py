"""Random rooms with zero to six people in front of a depth camera, every pixel labelled.

For training and evaluating the people finder. People stand, walk, sit at tables and deep in sofas,
lie under blankets, carry children and things, touch furniture and each other, hide behind both, are cut off
by the image's border; a third of them are nearer than 2.2 m. Around them are objects that an untrained finder
mistakes for people: coats on stands, jackets on chairs, pillars, plants, pets, slanted bare walls, screens
that return no light. Cameras are mounted as in `MOUNTINGS`. A tenth of the scenes are studios: people before
a plain wall or before nothing.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.sim.crowds import place_people
from depth_pose.sim.lookalikes import add_lookalikes
from depth_pose.sim.placed import Placed
from depth_pose.sim.rooms import add_backdrop, furnish, make_room
from depth_pose.sim.scene_noise import SceneSensor, Shown, measure, sample_sensor
from depth_pose.sim.scene_view import View, draw, look, silhouette_area
from depth_pose.sim.shapes import Kind, Triangles, triangulate

Array = NDArray[np.float64]

MOST_PEOPLE = 6
"""Maximum number of people in a scene: one for each of `_PEOPLE_SHARES`."""
_NOBODY_SHARE = 0.15
"""Share of scenes without anybody."""
_PEOPLE_SHARES = (0.38, 0.27, 0.15, 0.1, 0.06, 0.04)  # one to six
_ASPECTS = (4 / 3, 16 / 9, 11 / 9, 1.0)
"""Width of an image by its height."""
_ASPECT_SHARES = (0.7, 0.12, 0.1, 0.08)
"""How often each is drawn."""
MOUNTINGS = {"common": 0.58, "ceiling": 0.24, "rolled": 0.1, "low": 0.08}
"""Shares of mountings: on a stand, shelf or robot; from a ceiling, looking down by 40 to 90
degrees; likewise but rolled onto a side or upside down; near the floor."""
_JOINT_SLACK_M = 0.25  # maximum depth of a joint below its owner's surface
EVERY = 12
"""Stride over a person's vertices in the intersection test with furniture."""


@dataclass(frozen=True)
class Scene:
    """A measured image of a room and the truth about it.

    Attributes
    ----------
    depth : (H, W) float32
        As a sensor measures it, metres; 0 where nothing returned.
    clean : (H, W) float32
        Without noise, with no limit of range.
    person : (H, W) uint8
        Number, from 1, of the person at each pixel of `clean`; 0 for nobody. Worn clothes count as the
        person, carried objects do not.
    kind : (H, W) uint8
        `depth_pose.sim.shapes.Kind` of what a pixel of `clean` shows.
    camera : Camera
    joints : (P, 19, 3) float32
        Optical frame, metres.
    visible : (P,) float32
        Visible share of the silhouette that an image without borders would show of the person alone.
    seen : (P, 19) bool
        Whether a joint is inside the image and hidden by nothing but its owner.
    up : (3,) float32
        Unit vector away from the floor, optical frame.
    height : float
        Of the camera above the floor, metres.
    sensor : str
        The sensor's family: ``structured``, ``tof`` or ``stereo``; at home one of
        `depth_pose.sim.home_sensors.HOME_FAMILIES`.
    returned : (P,) float32
        Share of a person's pixels of `person` that have depth; 0 for who is not shown.
    fabrics : tuple of tuple of str
        Materials of each person's hair, top, trousers and shoes; empty where unknown.
    background : (H, W) float32 or None
        The same room without people and pets, as the sensor measures it, metres; None if not asked for.
    """

    depth: NDArray[np.float32]
    clean: NDArray[np.float32]
    person: NDArray[np.uint8]
    kind: NDArray[np.uint8]
    camera: Camera
    joints: NDArray[np.float32]
    visible: NDArray[np.float32]
    seen: NDArray[np.bool_]
    up: NDArray[np.float32]
    height: float
    sensor: str
    returned: NDArray[np.float32]
    fabrics: tuple[tuple[str, ...], ...] = ()
    background: NDArray[np.float32] | None = None


def sample_scene(
    rng: np.random.Generator,
    *,
    width: int = 320,
    people: int | None = None,
    studio: bool | None = None,
    lookalikes: bool = False,
    mounting: str | None = None,
    sensor: str | SceneSensor | None = None,
    with_background: bool = False,
) -> Scene:
    """Make a random scene.

    Parameters
    ----------
    rng : numpy.random.Generator
        Same state, same scene.
    width : int
        The image fits into ``width`` by three quarters of it; a 4:3 image fills that.
    people : int, optional
        How many, 0 to `MOST_PEOPLE`; drawn where not given. Where the room has no space for all there
        are fewer.
    studio : bool, optional
        Whether people stand before a plain wall or nothing; drawn where not given.
    lookalikes : bool
        Whether a room gets many things that look like people.
    mounting : str, optional
        One of `MOUNTINGS`; drawn where not given.
    sensor : str or SceneSensor, optional
        The sensor, or its family, one of `FAMILIES`; drawn where not given. The same state gives the same
        people and room with each.
    with_background : bool
        Whether the empty room is measured, too.
    """
    if people is None:
        shares = _NOBODY_SHARE, *((1 - _NOBODY_SHARE) * np.array(_PEOPLE_SHARES))
        people = int(rng.choice(1 + MOST_PEOPLE, p=shares))
    view = sample_view(rng, width, mounting)
    room = make_room(rng, float(view.position[1]), studio)
    persons = place_people(rng, people, view, room)
    points = [p.vertices[::EVERY] for p in persons]
    if room.studio:
        add_backdrop(room, rng, [float(p[:, 2].max()) for p in points])
    else:
        if lookalikes:
            add_lookalikes(room, rng, view, min(room.walls.back, 5.0))
        furnish(room, rng, points, view, min(room.walls.back, 9.0))
    surfaces = triangulate(room.shapes, rng)
    seen_by = sensor if isinstance(sensor, SceneSensor) else sample_sensor(rng, sensor)
    scene = render(view, surfaces, persons, seen_by, rng)
    return add_background(scene, view, surfaces, seen_by, rng) if with_background else scene


def add_background(
    scene: Scene, view: View, room: Triangles, sensor: SceneSensor, rng: np.random.Generator
) -> Scene:
    """Measure the same room without people and pets, and return the scene with it."""
    stays = room.kind != Kind.PET
    still = replace(room, faces=room.faces[stays], kind=room.kind[stays], albedo=room.albedo[stays])
    return replace(scene, background=render(view, still, (), sensor, rng.spawn(1)[0]).depth)


def sample_view(rng: np.random.Generator, width: int, mounting: str | None = None) -> View:
    """Draw a camera: field of view, shape of the image, and one of `MOUNTINGS`: height, tilt and roll."""
    camera = sample_camera(rng, width)
    mounting = mounting or str(rng.choice(list(MOUNTINGS), p=list(MOUNTINGS.values())))
    return mount(rng, camera, mounting)


def sample_camera(rng: np.random.Generator, width: int) -> Camera:
    """Sample a field of view and an image that fits into ``width`` by three quarters of it."""
    aspect = float(rng.choice(_ASPECTS, p=_ASPECT_SHARES))
    tall = min(round(width * 3 / 4), round(width / aspect))
    wide = min(width, round(tall * aspect))
    focal = wide / 2 / np.tan(np.deg2rad(rng.choice([rng.uniform(40, 90), rng.normal(58, 3)])) / 2)
    focal = float(np.clip(focal, wide * 0.5, wide * 1.374))  # 90 to 40 degrees
    cx, cy = (wide - 1) / 2 + rng.normal(0, 0.01 * wide), (tall - 1) / 2 + rng.normal(0, 0.01 * wide)
    return Camera(wide, tall, focal, focal * rng.normal(1, 0.003), float(cx), float(cy))


def mount(rng: np.random.Generator, camera: Camera, mounting: str) -> View:
    """Sample a camera's height, tilt and roll in one of `MOUNTINGS`, or on a ``robot`` or a ``shelf``."""
    if mounting == "ceiling":
        height, pitch, roll = rng.uniform(2.1, 4.0), rng.uniform(40, 90), rng.uniform(-180, 180)
        if rng.random() < 0.6:  # the image's lower side is the nearer
            roll = rng.normal(0, 5)
        return look(camera, height, float(np.deg2rad(pitch)), float(np.deg2rad(roll)))
    height = rng.uniform(0.4, 3.0) if rng.random() < 0.4 else float(np.clip(rng.normal(1.3, 0.4), 0.4, 3.0))
    if mounting == "low":
        height = rng.uniform(0.3, 0.6)
    elif mounting == "robot":
        height = rng.uniform(0.3, 1.2)
    elif mounting == "shelf":
        height = rng.uniform(1.5, 2.4)
    # some cut off heads, some feet
    aim = rng.uniform(0.5, 1.4) if rng.random() < 0.85 else rng.uniform(-0.2, 2.0)
    pitch = np.rad2deg(np.arctan2(height - aim, rng.uniform(1.2, 5.0))) + rng.normal(0, 7)
    roll = rng.normal(0, 2) if rng.random() < 0.8 else rng.normal(0, 8)
    if mounting == "rolled":
        roll += float(rng.choice([90.0, -90.0, 180.0, rng.uniform(-180, 180)]))
    return look(camera, height, float(np.deg2rad(np.clip(pitch, -30, 60))), float(np.deg2rad(roll)))


def render(
    view: View,
    room: Triangles,
    persons: Sequence[Placed],
    sensor: SceneSensor,
    rng: np.random.Generator,
    steady_seed: int | None = None,
) -> Scene:
    """Measure people in a room and label every pixel.

    Parameters
    ----------
    view : View
    room : Triangles
        Room frame.
    persons : sequence of Placed
    sensor : SceneSensor
    rng : numpy.random.Generator
        Of the sensor's noise.
    steady_seed : int, optional
        As in `depth_pose.sim.scene_noise.measure`.
    """
    optical = [view.to_optical(p.vertices) for p in persons]
    parts = [(view.to_optical(room.vertices), room.faces)]
    of_kind, owners, albedos = [room.kind], [np.zeros(len(room.faces), np.uint8)], [room.albedo]
    for i, person in enumerate(persons):
        bodies = (optical[i], person.faces), (view.to_optical(person.held_vertices), person.held_faces)
        parts += bodies
        for (_, faces), kind, owner in zip(bodies, (Kind.PERSON, Kind.HELD), (i + 1, 0), strict=True):
            of_kind.append(np.full(len(faces), kind, np.uint8))
            owners.append(np.full(len(faces), owner, np.uint8))
        albedos += [person.albedo, np.full(len(person.held_faces), person.held_albedo, np.float32)]
    drawn = draw(*_joined(parts), view.camera)
    # the last entry of each list stands for face -1, none
    own = np.append(np.concatenate(owners), np.uint8(0))[drawn.face]
    shows = np.append(np.concatenate(of_kind), np.uint8(Kind.NOTHING))[drawn.face]
    albedo = np.append(np.concatenate(albedos), np.float32(0))[drawn.face]
    joints = np.array([view.to_optical(p.joints) for p in persons]).reshape(-1, 19, 3)
    areas = [silhouette_area(o, p.faces, view.camera) for o, p in zip(optical, persons, strict=True)]
    shown = np.bincount(own.ravel(), minlength=len(persons) + 1)[1:]
    depth = measure(Shown(drawn.depth, drawn.cosine, albedo, view.camera.fx), sensor, rng, steady_seed)
    returned = np.bincount(own[depth > 0], minlength=len(persons) + 1)[1:]
    return Scene(
        depth=depth,
        clean=drawn.depth,
        person=own,
        kind=shows,
        camera=view.camera,
        joints=joints.astype(np.float32),
        visible=np.clip(shown / np.maximum(areas, 1.0), 0, 1).astype(np.float32),
        seen=_seen(view, joints, drawn.depth, own),
        up=view.rotation[:, 1].astype(np.float32),
        height=float(view.position[1]),
        sensor=sensor.family,
        returned=(returned / np.maximum(shown, 1)).astype(np.float32),
        fabrics=tuple(p.fabrics for p in persons),
    )


def _joined(parts: Sequence[tuple[Array, NDArray[np.int64]]]) -> tuple[Array, NDArray[np.int64]]:
    first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = [f + start for (_, f), start in zip(parts, first, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def _seen(view: View, joints: Array, depth: NDArray[np.float32], own: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Whether each joint is inside the image and not occluded by anything but its owner."""
    pixels = np.rint(np.nan_to_num(view.project(joints), nan=-1.0, posinf=-1.0, neginf=-1.0))
    size = np.array([view.camera.width, view.camera.height])
    inside = np.all((pixels >= 0) & (pixels < size), axis=-1)
    u, v = np.clip(pixels, 0, size - 1).astype(np.int64).transpose(2, 0, 1)
    is_own = own[v, u] == 1 + np.arange(len(joints))[:, None]
    free = (depth[v, u] >= joints[..., 2] - _JOINT_SLACK_M) | (depth[v, u] <= 0)
    return np.asarray(inside & (is_own | free))
