"""People who are placed in a room's view: standing, seated, lying, beside and behind each other.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.sim.materials import Wardrobe, sample_dark
from depth_pose.sim.people import Figure, sample_figure
from depth_pose.sim.placed import Placed, place
from depth_pose.sim.resting import Settled, child_in_arms, settle
from depth_pose.sim.rooms import Room
from depth_pose.sim.scene_view import View

Spot = tuple[float, float, float]
"""x and z of a place on the floor, and a turn about the vertical, radians."""

_NEAR_SHARE, _NEAR_M, _MIDDLE_M, _FAR_M = 1 / 3, 0.6, 2.2, 6.0
"""Share of people who are near; ranges of near and of far people, metres."""
_AT_TABLE_SHARE = 0.6
"""Share of people seated on chairs who join an occupied table."""
_CLEAR_ABOVE_M = 0.3
"""Minimum distance of heads below an overhead camera, metres."""
_TRIES = 12
"""Number of spots tried for each person."""


@dataclass(frozen=True)
class Casting:
    """How people are sampled.

    Attributes
    ----------
    figure : callable
        Draws a figure.
    wardrobe : callable, optional
        Draws the materials of hair and clothes; without it clothes have any albedo.
    dark : float
        Share of seats and beds that return little light.
    """

    figure: Callable[[np.random.Generator], Figure] = sample_figure
    wardrobe: Callable[[np.random.Generator], Wardrobe] | None = None
    dark: float = 0.0

    def place(self, figure: Figure, spot: Spot, rng: np.random.Generator) -> Placed:
        """Place a figure in clothes."""
        return place(figure, *spot, rng, None if self.wardrobe is None else self.wardrobe(rng))

    def settle(self, figure: Figure, rng: np.random.Generator, seat: str | None) -> Settled:
        """Add what a figure rests on."""
        settled = settle(figure, rng, seat)
        for thing in settled.things if self.dark else ():
            if rng.random() < self.dark:
                thing.repaint(sample_dark(rng))
        return settled


_ANYBODY = Casting()


def place_people(
    rng: np.random.Generator, count: int, view: View, room: Room, casting: Casting = _ANYBODY
) -> list[Placed]:
    """Place people within the camera's view, without intersections; their supports are added to the room."""
    persons: list[Placed] = []
    seats: list[Spot] = []
    for _ in range(count):
        figure = casting.figure(rng)
        sits = figure.posture == "sit" and figure.seat_height > 0
        for _ in range(_TRIES):
            at_table = bool(sits and seats and rng.random() < _AT_TABLE_SHARE)
            settled = casting.settle(figure, rng, "chair" if at_table else None)
            spot = seats.pop() if at_table else _spot(rng, view, persons)
            person = casting.place(settled.figure, spot, rng)
            if not _fits(person, view, room, persons):
                continue
            if not room.studio and not _put_things(settled, spot, room, at_table):
                continue
            persons.append(person)
            seats += [] if at_table else _seats(settled, spot)
            child = child_in_arms(figure, rng)
            if child is not None and len(persons) < count:
                persons.append(casting.place(child, spot, rng))
            break
        if len(persons) == count:
            break
    return persons


def _put_things(settled: Settled, spot: Spot, room: Room, at_table: bool) -> bool:
    """Place a person's supports, except a second table; return whether the person rests on them."""
    things = settled.things[:1] if at_table else settled.things
    # a table may have no space, a seat must
    stand = [room.put(thing, *spot, crowded=0.0) for thing in things]
    return not stand or stand[0]


def _seats(settled: Settled, spot: Spot) -> list[Spot]:
    """Return the other places at the table where somebody sits."""
    if settled.table <= 0:
        return []
    x, z, turn = spot
    c, s = np.cos(turn), np.sin(turn)
    across = 2 * settled.table
    return [
        (float(x + c * a + s * b), float(z + c * b - s * a), float(turn + t))
        for a, b, t in ((-0.7, 0.0, 0.0), (0.7, across, np.pi), (0.7, 0.0, 0.0), (0.0, across, np.pi))
    ]


def _spot(rng: np.random.Generator, view: View, persons: Sequence[Placed]) -> Spot:
    """Draw a spot on the floor: anywhere in view, beside somebody, or behind somebody."""
    turn = np.pi + rng.normal(0, 0.8) if rng.random() < 0.45 else rng.uniform(0, 2 * np.pi)
    if persons and rng.random() < 0.5:
        other = persons[int(rng.integers(len(persons)))].joints[JOINT_INDEX["pelvis"]]
        if rng.random() < 0.6 or view.overhead:
            angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.9)
            return float(other[0] + away * np.cos(angle)), float(other[2] + away * np.sin(angle)), turn
        farther = 1 + rng.uniform(0.4, 1.5) / max(float(np.hypot(other[0], other[2])), 0.3)
        return float(farther * other[0] + rng.normal(0, 0.15)), float(farther * other[2]), turn
    near = rng.random() < _NEAR_SHARE
    away = rng.uniform(_NEAR_M, _MIDDLE_M) if near else rng.uniform(_MIDDLE_M, _FAR_M)
    return *view.floor_spot(rng, away), turn


def _fits(person: Placed, view: View, room: Room, others: Sequence[Placed]) -> bool:
    low, high = person.vertices.min(axis=0), person.vertices.max(axis=0)
    if view.overhead:
        if high[1] > view.position[1] - _CLEAR_ABOVE_M:
            return False
    elif low[2] < 0.25:
        return False
    if high[1] > room.walls.height:
        return False
    if any(room.walls.inward(x, z) < 0.02 for x in (low[0], high[0]) for z in (low[2], high[2])):
        return False
    if any(_inside_one_another(person, other) for other in others):
        return False
    pixels = view.project(view.to_optical(person.joints))
    size = np.array([view.camera.width, view.camera.height])
    return int(np.sum(np.all((pixels > 0) & (pixels < size), axis=1))) >= 3


def _inside_one_another(one: Placed, other: Placed) -> bool:
    """Whether trunks intersect; limbs may touch and intersect slightly."""
    trunk = [JOINT_INDEX[name] for name in ("pelvis", "chest", "head", "left_knee", "right_knee")]
    apart = np.linalg.norm(one.joints[trunk][:, None] - other.joints[trunk][None], axis=-1)
    return float(apart.min()) < 0.28
