"""Random rooms: shell, fixtures on the walls, and places for furniture.

The camera is above the origin of the room frame (y up, z away from it along the floor, metres); the
walls are around it, rotated by some angle.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from depth_pose.sim.furniture import AT_WALLS, STANDING, make_table
from depth_pose.sim.scene_view import View
from depth_pose.sim.shapes import Assembly, Kind, random_albedo

Array = NDArray[np.float64]
Maker = Callable[[np.random.Generator], Assembly]

_STUDIO_SHARE = 0.1
"""Share of studios among rooms."""
_CLEAR_OF_CAMERA_M = 0.35
"""Free floor between the camera and objects that end 15 cm or more below it, metres."""
_TALL_CLEAR_OF_CAMERA_M = 0.9
"""The same for taller things."""
_HUNG_M = 2.2
"""Height above which cameras hang from ceilings, not only in front of a wall, metres."""
_BELOW_CAMERA_M = 0.8
"""Objects that end this far below a ceiling camera may stand anywhere, metres."""
_HIDES_FROM_M = 0.8  # people behind lower objects can still be found
_TRIES = 6
"""Number of spots tried for each object."""


@dataclass(frozen=True)
class Walls:
    """Positions of the walls relative to the camera, before rotation.

    Attributes
    ----------
    left, right, back, behind : float
        Distance of the walls from the camera, metres; right is -x, back is +z.
    height : float
        Of the ceiling.
    turn : float
        Of the room about the vertical through the camera, radians.
    """

    left: float
    right: float
    back: float
    behind: float
    height: float
    turn: float

    def inward(self, x: float, z: float) -> float:
        """Distance of a spot on the floor from the nearest wall; negative outside the room."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        wx, wz = c * x - s * z, s * x + c * z
        return float(min(self.left - wx, wx + self.right, self.back - wz, wz + self.behind))

    def spot(self, wx: float, wz: float) -> tuple[float, float]:
        """Convert a spot from the walls' own frame to the room frame, x and z."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return float(c * wx + s * wz), float(c * wz - s * wx)


_EVERYWHERE = Walls(50.0, 50.0, 50.0, 50.0, 50.0, 0.0)
"""Distance of a studio's walls and ceiling, metres: far enough to restrict nobody."""


@dataclass
class Room:
    """A room while it is being furnished.

    Attributes
    ----------
    walls : Walls
    studio : bool
        Whether there is at most one wall, and no visible floor.
    eye_height : float
        Height of the camera above the floor, metres.
    shapes : Assembly
        All surfaces so far, room frame.
    ways : list of (T, 2) arrays
        In videos: people's positions, x and z, one row per frame; no object is placed that hides one of them
        for more than `longest_hidden` consecutive frames.
    longest_hidden : int
    free : list of (N, 3) arrays
        Points that every object leaves free: paths of cameras and pets.
    """

    walls: Walls
    studio: bool
    eye_height: float
    shapes: Assembly = field(default_factory=lambda: Assembly(Kind.WALL))
    ways: list[Array] = field(default_factory=list)
    longest_hidden: int = 0
    free: list[Array] = field(default_factory=list)
    _spots: list[tuple[float, float, float]] = field(default_factory=list)

    def put(
        self,
        thing: Assembly,
        x: float,
        z: float,
        turn: float,
        avoid: Sequence[Array] = (),
        crowded: float = 0.7,
    ) -> bool:
        """Place an object unless it intersects a person, the camera or another object.

        Parameters
        ----------
        thing : Assembly
        x, z, turn : float
            Position and rotation, room frame.
        avoid : sequence of (V, 3) arrays
            Points of people that must stay outside the thing's bounding box.
        crowded : float
            Share of its radius that must be free of other things; 0 to ignore them.

        Returns
        -------
        bool
            Whether it was placed.
        """
        low, high = thing.bounds()
        radius = 0.5 * float(np.hypot(high[0] - low[0], high[2] - low[2]))
        # an object close to the camera would fill the image
        clear = _CLEAR_OF_CAMERA_M if high[1] < self.eye_height - 0.15 else _TALL_CLEAR_OF_CAMERA_M
        if high[1] > self.eye_height - _BELOW_CAMERA_M and np.hypot(x, z) < radius * 0.7 + clear:
            return False
        if any(np.hypot(x - a, z - b) < crowded * (radius + r) for a, b, r in self._spots if crowded > 0):
            return False
        if high[1] > _HIDES_FROM_M and any(self._hides_too_long(way, x, z, radius) for way in self.ways):
            return False
        c, s = np.cos(turn), np.sin(turn)
        for points in (*avoid, *self.free):
            dx, dz = points[:, 0] - x, points[:, 2] - z
            own = np.stack([c * dx - s * dz, points[:, 1], s * dx + c * dz], axis=1)
            if np.any(np.all((own > low) & (own < high), axis=1)):
                return False
        self.shapes.add(thing, x, 0.0, z, turn)
        self._spots.append((x, z, radius))
        return True

    def put_at_wall(self, rng: np.random.Generator, thing: Assembly, avoid: Sequence[Array]) -> None:
        """Place an object with its back to the left, right or back wall."""
        low, _ = thing.bounds()
        w, off = self.walls, 0.03 - low[2]
        for _ in range(_TRIES):
            side = rng.integers(0, 3)
            if side == 2:
                wx, wz, turn = rng.uniform(-w.right, w.left), w.back - off, np.pi
            else:
                wz = rng.uniform(0.3, w.back)
                wx, turn = (w.left - off, -np.pi / 2) if side == 0 else (off - w.right, np.pi / 2)
            x, z = w.spot(wx, wz)
            if is_before(thing, x, z, avoid) and rng.random() < 0.8:
                continue
            if self.put(thing, x, z, turn + w.turn, avoid):
                return

    def _hides_too_long(self, way: Array, x: float, z: float, radius: float) -> bool:
        away = np.maximum(np.linalg.norm(way, axis=1), 1e-6)
        along = (x * way[:, 0] + z * way[:, 1]) / away
        aside = np.abs(x * way[:, 1] - z * way[:, 0]) / away
        free = np.flatnonzero(np.r_[True, ~((along > 0) & (along < away) & (aside < radius)), True])
        return int(np.diff(free).max()) - 1 > self.longest_hidden


def make_room(rng: np.random.Generator, eye_height: float, studio: bool | None = None) -> Room:
    """Draw a room's shell: an office, a corridor, a hall, or a studio's plain background.

    The camera is `eye_height` metres above the floor. ``studio`` is random by default.
    """
    drawn = rng.random() < _STUDIO_SHARE
    if drawn if studio is None else studio:
        return Room(_EVERYWHERE, True, eye_height)
    style = rng.choice(4, p=[0.5, 0.15, 0.15, 0.2])
    height = rng.uniform(2.3, 3.4)
    if style == 0:
        left, right = rng.uniform(0.7, 4.0), rng.uniform(0.7, 4.0)
        back, turn = rng.uniform(3, 8.5), rng.normal(0, 0.4)
    elif style == 1:
        left, right = rng.uniform(0.35, 1.7), rng.uniform(0.35, 1.7)
        back, turn = rng.uniform(4, 14), rng.normal(0, 0.2)
    elif style == 2:
        left, right, back, turn = *rng.uniform(3, 9, 2), rng.uniform(7, 16), rng.normal(0, 0.5)
        height = rng.uniform(3, 6)
    else:
        left, right, back, turn = *rng.uniform(1.2, 3, 2), rng.uniform(2.0, 4.0), rng.uniform(-0.8, 0.8)
    height = max(height, eye_height + 0.15)
    behind = rng.uniform(0.3, 3.0) if eye_height < _HUNG_M else rng.uniform(0.5, 4.0)
    walls = Walls(left, right, back, behind, height, float(np.clip(turn, -1.0, 1.0)))
    room = Room(walls, False, eye_height)
    _put_shell(room, rng)
    return room


def add_backdrop(room: Room, rng: np.random.Generator, reaches: Sequence[float]) -> None:
    """Place a studio wall behind all people in half of the scenes; `reaches` is each person's reach."""
    if not reaches or rng.random() < 0.5:
        z, turn = max(reaches, default=1.0) + rng.uniform(0.3, 2.5), rng.normal(0, 0.15)
        room.shapes.box((0.0, 0.0, z), (40.0, 40.0, 0.02), turn, 0.0, Kind.WALL, rng.uniform(0.4, 0.9))


def _put_shell(room: Room, rng: np.random.Generator) -> None:
    """Add floor, ceiling, walls, and fixtures in and on them."""
    w, shell = room.walls, Assembly(Kind.WALL)
    wide, deep = w.left + w.right, w.back + w.behind
    middle_x, middle_z = (w.left - w.right) / 2, (w.back - w.behind) / 2
    shell.box((middle_x, -0.01, middle_z), (wide, 0.02, deep), 0, 0, Kind.FLOOR, rng.uniform(0.1, 0.8))
    if rng.random() < 0.9:
        at = (middle_x, w.height + 0.01, middle_z)
        shell.box(at, (wide, 0.02, deep), 0, 0, Kind.CEILING, rng.uniform(0.4, 0.9))
    paint = rng.uniform(0.4, 0.9)
    sides = (
        ((w.left, middle_z), deep, -np.pi / 2),
        ((-w.right, middle_z), deep, np.pi / 2),
        ((middle_x, w.back), wide, np.pi),
        ((middle_x, -w.behind), wide, 0.0),
    )
    for (x, z), long, turn in sides:
        wall = Assembly(Kind.WALL, paint)
        wall.box((0, w.height / 2, -0.01), (long, w.height, 0.02))
        for _ in range(int(rng.poisson(0.25 * long))):
            _hang(wall, rng, rng.uniform(-0.5, 0.5) * long)
        shell.add(wall, x, 0, z, turn)
    if rng.random() < 0.35:
        _put_beams(shell, rng, w)
    room.shapes.add(shell, 0, 0, 0, w.turn)


def _hang(wall: Assembly, rng: np.random.Generator, x: float) -> None:
    """Hang a picture, board or poster on a wall in the plane z = 0, or let a window into it."""
    what, size = rng.integers(0, 4), rng.uniform((0.3, 0.3), (1.8, 1.4))
    y = rng.uniform(1.0, 1.9)
    if what == 0:  # glass returns nothing, its frame does
        wall.box((x, y, 0.005), (size[0], size[1], 0.01), 0, 0, Kind.WALL, 0.004)
        wall.box((x, y - size[1] / 2, 0.06), (size[0] + 0.1, 0.04, 0.16))
        wall.box((x, y, 0.02), (0.06, size[1], 0.05))
    elif what == 1:
        wall.box((x, y, 0.02), (size[0], size[1], 0.04), 0, 0, Kind.BOARD, random_albedo(rng))
    elif what == 2:
        wall.box((x, 1.05, 0.01), (0.95, 2.1, 0.05), 0, 0, Kind.DOOR, random_albedo(rng, 0.1))
        wall.box((x, 1.07, 0.02), (1.1, 2.14, 0.015), 0, 0, Kind.DOOR)
    else:
        wall.box((x, y * 0.3, 0.07), (size[0], 0.5, 0.12), 0, 0, Kind.PIPE)


def _put_beams(shell: Assembly, rng: np.random.Generator, w: Walls) -> None:
    """Add beams, lamps or ducts below the ceiling."""
    for z in np.arange(0.5, w.back, rng.uniform(1.2, 3.0)):
        if rng.random() < 0.5:
            shell.box((0.0, w.height - 0.12, z), (w.left + w.right, 0.24, 0.2), 0, 0, Kind.CEILING)
        else:
            x = rng.uniform(-w.right, w.left)
            shell.box((x, w.height - 0.25, z), (0.25, 0.08, 1.2), 0, 0, Kind.LAMP)


def furnish(room: Room, rng: np.random.Generator, avoid: Sequence[Array], view: View, reach: float) -> None:
    """Fill a room with furniture that does not intersect people.

    Parameters
    ----------
    room : Room
    rng : numpy.random.Generator
    avoid : sequence of (V, 3) arrays
        Points of the people, room frame.
    view : View
        Most objects stand in its view.
    reach : float
        Maximum distance of objects, metres.
    """
    if rng.random() < 0.12:  # a desk close to the camera
        desk = make_table(rng, rng.uniform(0.4, 0.9))
        room.put(desk, rng.normal(0, 0.3), rng.uniform(0.7, 1.3), np.pi + rng.normal(0, 0.4), avoid, 0.0)
    for _ in range(int(rng.poisson(5))):
        room.put_at_wall(rng, draw_thing(rng, AT_WALLS), avoid)
    for points in avoid:
        if rng.random() < 0.3:
            _put_before(room, rng, points, avoid)
    for _ in range(int(rng.poisson(rng.choice([2.0, 7.0, 14.0])))):
        thing = draw_thing(rng, STANDING)
        for _ in range(_TRIES):
            away = rng.uniform(0.5, 1.0) ** 0.7 * reach * rng.uniform(0.2, 1.0)
            x, z = view.floor_spot(rng, away, 1.15)
            if is_before(thing, x, z, avoid) and rng.random() < 0.8:
                continue
            if room.walls.inward(x, z) > 0.2 and room.put(thing, x, z, rng.uniform(0, 2 * np.pi), avoid):
                break


def is_before(thing: Assembly, x: float, z: float, avoid: Sequence[Array]) -> bool:
    """Whether an object at a spot stands between the camera and the middle of a person."""
    low, high = thing.bounds()
    radius = 0.35 * float(np.hypot(high[0] - low[0], high[2] - low[2]))
    for points in avoid:
        px, _, pz = points.mean(axis=0)
        away = max(float(np.hypot(px, pz)), 1e-6)
        along, aside = (x * px + z * pz) / away, abs(x * pz - z * px) / away
        if 0 < along < away and aside < radius + 0.15 and high[1] > 0.6:
            return True
    return False


def _put_before(room: Room, rng: np.random.Generator, points: Array, avoid: Sequence[Array]) -> None:
    """Place an object between the camera and a person, or touching the person from the side."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for _ in range(_TRIES):
        thing = draw_thing(rng, STANDING)
        if rng.random() < 0.5:
            x, _, z = middle * rng.uniform(0.35, 0.85) + rng.normal(0, 0.15, 3)
        else:
            low, high = thing.bounds()
            angle, away = rng.uniform(0, 2 * np.pi), 0.5 * float(high[0] - low[0]) + rng.uniform(0.0, 0.3)
            x, z = middle[0] + away * np.cos(angle), middle[2] + away * np.sin(angle)
        turn = np.pi + rng.normal(0, 0.5) if rng.random() < 0.6 else rng.uniform(0, 2 * np.pi)
        if room.walls.inward(x, z) > 0.1 and room.put(thing, x, z, turn, avoid, 0.3):
            return


def draw_thing(rng: np.random.Generator, makers: Sequence[tuple[Maker, float]]) -> Assembly:
    """Make an object with one of some makers, drawn by their frequencies."""
    shares = np.array([share for _, share in makers])
    return makers[int(rng.choice(len(makers), p=shares / shares.sum()))][0](rng)
