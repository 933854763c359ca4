"""Random homes: dark clothes and sofas, pets, clutter, half-hidden people, four families of sensors.

The scenes of `depth_pose.sim.scenes` with the contents of homes: materials that return no light
(`depth_pose.sim.materials`), 15 to 40 pieces of furniture with pets among them (`depth_pose.sim.homes`)
people behind cloth, boards, tables and counters, who sit, lie, bend and kneel more often, in coats or skirts;
cameras on robots and shelves too; active and passive stereo (`depth_pose.sim.home_sensors`).

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from depth_pose.core.camera import Camera
from depth_pose.sim.crowds import Casting, place_people
from depth_pose.sim.home_sensors import sample_home_sensor
from depth_pose.sim.homes import furnish_home
from depth_pose.sim.lookalikes import add_lookalikes
from depth_pose.sim.materials import sample_wardrobe
from depth_pose.sim.people import HOLDS_M, Figure, sample_figure
from depth_pose.sim.placed import Placed
from depth_pose.sim.rooms import make_room
from depth_pose.sim.scene_noise import SceneSensor
from depth_pose.sim.scene_view import View
from depth_pose.sim.scenes import EVERY, Scene, add_background, mount, render, sample_camera
from depth_pose.sim.shapes import Triangles, triangulate

HOME_MOUNTINGS = {
    "common": 0.36, "robot": 0.2, "shelf": 0.18, "ceiling": 0.14, "low": 0.06, "rolled": 0.06,
}  # fmt: skip
"""Shares of mountings at home: those of `depth_pose.sim.scenes.MOUNTINGS`, on robots (0.3 to 1.2 m) and on
shelves."""

UPRIGHT_MOUNTINGS = ("common", "robot", "robot", "shelf")
"""Mountings of cameras in recordings of homes, in which people walk about."""

HOME_POSTURES = {
    "stand": 0.2, "walk": 0.13, "sit": 0.28, "lie": 0.12, "bend": 0.08,
    "reach": 0.05, "kneel": 0.06, "squat": 0.04, "crawl": 0.02, "lean": 0.02,
}  # fmt: skip
"""Frequency of each posture at home."""

_PEOPLE_SHARES = (0.2, 0.38, 0.22, 0.1, 0.05, 0.03, 0.02)
"""Shares of homes with zero to six people."""
WRAPPED = 2.5
"""Factor on the shares of people in coats, skirts and cloaks and with bags."""
CHILDREN, CHILD_M = 0.12, 1.3
"""Share of people who are always small children, and their maximum stature (m)."""
HOLDING = 0.12
"""Share of standing people who hold a cloth or board up before themselves."""
_DARK_SEATS = 0.3
"""Share of seats and beds that return little light."""
_LOOKALIKES = 0.2
"""Share of homes with clothes on hooks and in heaps."""
_WIDE = 0.6
"""Share of passive stereo cameras with a wide image."""


class Home(NamedTuple):
    """A home before it is measured.

    Attributes
    ----------
    view : View
        The camera.
    surfaces : Triangles
        Room, furniture and pets.
    persons : list of Placed
    sensor : SceneSensor
    """

    view: View
    surfaces: Triangles
    persons: list[Placed]
    sensor: SceneSensor


def sample_home(
    rng: np.random.Generator,
    *,
    width: int = 320,
    people: int | None = None,
    mounting: str | None = None,
    sensor: str | None = None,
    with_background: bool = False,
) -> Scene:
    """Make a random home.

    Parameters are those of `depth_pose.sim.scenes.sample_scene`; mountings are those of `HOME_MOUNTINGS` and
    families of sensors those of `depth_pose.sim.home_sensors.HOME_FAMILIES`.
    """
    home = furnished_home(rng, width=width, people=people, mounting=mounting, sensor=sensor)
    scene = render(home.view, home.surfaces, home.persons, home.sensor, rng)
    return add_background(scene, home.view, home.surfaces, home.sensor, rng) if with_background else scene


def furnished_home(
    rng: np.random.Generator,
    *,
    width: int = 320,
    people: int | None = None,
    mounting: str | None = None,
    sensor: str | None = None,
) -> Home:
    """Make a random home that is not measured yet; parameters are those of `sample_home`."""
    if people is None:
        people = int(rng.choice(len(_PEOPLE_SHARES), p=_PEOPLE_SHARES))
    seen_by = sample_home_sensor(rng, sensor)
    view = _sample_view(rng, width, mounting, seen_by.family)
    room = make_room(rng, float(view.position[1]), False)
    persons = place_people(rng, people, view, room, AT_HOME)
    points = [p.vertices[::EVERY] for p in persons]
    if rng.random() < _LOOKALIKES:
        add_lookalikes(room, rng, view, min(room.walls.back, 5.0))
    furnish_home(room, rng, points, view, min(room.walls.back, 8.0))
    return Home(view, triangulate(room.shapes, rng), persons, seen_by)


def sample_occupant(rng: np.random.Generator) -> Figure:
    """Sample a person as they are at home: by `HOME_POSTURES`, more children, more coats, skirts and bags."""
    names = list(HOME_POSTURES)
    posture = names[int(rng.choice(len(names), p=list(HOME_POSTURES.values())))]
    tallest = CHILD_M if rng.random() < CHILDREN else np.inf
    doing = None
    if posture == "stand" and rng.random() < HOLDING:
        doing = str(rng.choice(list(HOLDS_M)))
    return sample_figure(rng, posture, doing=doing, tallest=tallest, wrapped=WRAPPED)


def _sample_view(rng: np.random.Generator, width: int, mounting: str | None, family: str) -> View:
    """Sample a camera and where it is mounted; passive stereo cameras are often wide."""
    camera = sample_camera(rng, width)
    if family == "passive" and rng.random() < _WIDE:
        tall, spread = round(width * rng.choice([9 / 16, 10 / 16])), np.radians(rng.uniform(65.0, 100.0))
        focal = float(width / 2 / np.tan(spread / 2))
        camera = Camera(width, tall, focal, focal, (width - 1) / 2, (tall - 1) / 2)
    names, shares = list(HOME_MOUNTINGS), list(HOME_MOUNTINGS.values())
    return mount(rng, camera, mounting or str(rng.choice(names, p=shares)))


AT_HOME = Casting(sample_occupant, sample_wardrobe, _DARK_SEATS)
"""People at home."""
