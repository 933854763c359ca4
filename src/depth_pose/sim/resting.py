"""Supports and covers of people, such as seats, beds and blankets, fitted to their bodies.

Everything is made in the figure's own frame (metres, y up, facing +z, pelvis above the origin), and placed
with the same position and rotation as the figure.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.rotations import rotation_y
from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.sim._meshes import join
from depth_pose.sim.furniture import make_bed, make_chair, make_desk, make_stool, make_table
from depth_pose.sim.furniture.aids import make_crutch, make_walker, make_wheelchair
from depth_pose.sim.people import Figure, sample_figure
from depth_pose.sim.reliefs import CELL_M, Plane, cover, press, with_sides
from depth_pose.sim.shapes import Assembly, Kind, random_albedo

Array = NDArray[np.float64]

SEATS = {"chair": 0.34, "stool": 0.07, "sofa": 0.38, "edge of a bed": 0.08, "wheelchair": 0.13}
"""Frequency of each seat."""

_BLANKETS, _LAP_BLANKETS, _FLOOR_BLANKETS, _COUCHES = 0.65, 0.15, 0.3, 0.2
"""Shares of people in bed, on sofas and on the floor with a cover, and of beds with a back."""
_DESKS, _LADEN = 0.4, 0.4
"""Share of people on chairs and wheelchairs who sit at a table, and of these at a laden desk."""
_SMALL_M, _CARRIED_M = 1.3, (0.6, 0.95)
"""Statures, metres: maximum of the children from which carried ones are scaled, and range of carried ones."""
_HALF_TRUNK_M = 0.14
"""Half the width of the strip of a back that a backrest is fitted to, metres."""


@dataclass(frozen=True)
class Settled:
    """A figure with its supports.

    Attributes
    ----------
    figure : Figure
        Including its covers, which count as the person.
    things : tuple of Assembly
        Figure's frame.
    table : float
        Distance to the middle of the figure's table, ahead, metres; 0 for none.
    """

    figure: Figure
    things: tuple[Assembly, ...] = ()
    table: float = 0.0


def settle(figure: Figure, rng: np.random.Generator, seat: str | None = None) -> Settled:
    """Add what a figure needs around it: a seat, a bed, a table, a blanket, a walking frame.

    Parameters
    ----------
    figure : Figure
    rng : numpy.random.Generator
    seat : str, optional
        One of `SEATS` for seated figures; random by default.
    """
    if figure.posture == "lie":
        return _in_bed(figure, rng) if figure.seat_height > 0 else _on_floor(figure, rng)
    if figure.posture == "sit" and figure.seat_height > 0:
        return _on_seat(figure, rng, seat or str(rng.choice(list(SEATS), p=list(SEATS.values()))))
    if figure.doing in ("frame", "crutches"):
        return Settled(figure, tuple(_aids(figure, rng)))
    return Settled(figure)


def hands_of(figure: Figure) -> Array:
    """Return the palms of the left and the right hand (2, 3), metres."""
    wrist, elbow = (_joints(figure, f"left_{n}", f"right_{n}") for n in ("wrist", "elbow"))
    return np.asarray(wrist + 0.3 * (wrist - elbow))


def child_in_arms(figure: Figure, rng: np.random.Generator) -> Figure | None:
    """Make the small child that a figure carries, in the figure's frame; None if it carries none."""
    if figure.doing != "child":
        return None
    child = sample_figure(rng, "sit", tallest=_SMALL_M)
    while child.seat_height == 0:  # people who sit on the floor have their legs in front of them
        child = sample_figure(rng, "sit", tallest=_SMALL_M)
    size = rng.uniform(*_CARRIED_M) / child.stature
    hands, bottom = hands_of(figure), np.array([0.0, child.seat_height, 0.0])
    turn = rotation_y(np.array(rng.choice([np.pi / 2, -np.pi / 2, np.pi]) + rng.normal(0, 0.4)))
    low = hands[int(hands[:, 1].argmin())]
    spot = np.array([rng.uniform(0.3, 1.2) * low[0], low[1] - 0.02, hands[:, 2].mean()])
    vertices, joints = (
        (size * (points - bottom) @ turn.T + spot).astype(np.float32)
        for points in (child.vertices, child.joints)
    )
    return replace(
        child,
        vertices=vertices,
        joints=joints,
        held_vertices=child.held_vertices[:0],
        held_faces=child.held_faces[:0],
        stature=size * child.stature,
    )


def _joints(figure: Figure, *names: str) -> Array:
    return figure.joints[[JOINT_INDEX[n] for n in names]].astype(np.float64)


def _aids(figure: Figure, rng: np.random.Generator) -> list[Assembly]:
    """Make a walking frame, crutches or a stick for the hands."""
    hands = hands_of(figure)
    if figure.doing == "frame":
        return [make_walker(rng, hands)]
    elbows, shoulders = (_joints(figure, f"left_{n}", f"right_{n}") for n in ("elbow", "shoulder"))
    sides = (0, 1) if rng.random() < 0.6 else (int(rng.integers(2)),)
    return [make_crutch(rng, hands[k], elbows[k], shoulders[k]) for k in sides]


def _covered(figure: Figure, pieces: list[tuple[Array, NDArray[np.int32]]]) -> Figure:
    """Add meshes that count as the person."""
    own = (figure.vertices.astype(np.float64), figure.faces)
    vertices, faces = join([own, *pieces])
    return replace(figure, vertices=vertices.astype(np.float32), faces=faces)


def _flat(low: Array, high: Array, level: float) -> Plane:
    """Return a level plane of cells between two spots (x, z)."""
    count = np.maximum(np.ceil((high - low) / CELL_M).astype(int) + 1, 2)
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return Plane(np.array([low[0], level, low[1]]), axes, (int(count[1]), int(count[0])))


def _span(figure: Figure) -> tuple[Array, Array, float]:
    """Return both ends of a lying figure (x, z), and the sign of z toward the head."""
    low, high = (f(axis=0)[[0, 2]].astype(np.float64) for f in (figure.vertices.min, figure.vertices.max))
    neck, pelvis = _joints(figure, "neck", "pelvis")
    return low, high, 1.0 if neck[2] > pelvis[2] else -1.0


def _on_floor(figure: Figure, rng: np.random.Generator) -> Settled:
    """Cover some of the people who lie on the floor."""
    if rng.random() > _FLOOR_BLANKETS:
        return Settled(figure)
    low, high, toward = _span(figure)
    plane = _flat(low - 0.25, high + 0.25, 0.0)
    thing = Assembly(Kind.BED, random_albedo(rng, 0.1))
    return Settled(_blanket(figure, rng, thing, plane, np.zeros(plane.shape), toward), (thing,))


def _in_bed(figure: Figure, rng: np.random.Generator) -> Settled:
    """Make a bed or couch for a figure that lies along z: mattress, pillow, perhaps a blanket."""
    low, high, toward = _span(figure)
    couch = rng.random() < _COUCHES
    sunk, level = rng.uniform(0.01, 0.09), figure.seat_height
    wide = max(rng.uniform(0.65, 0.8) if couch else rng.choice([0.9, 1.0, 1.4, 1.8]), high[0] - low[0] - 0.3)
    middle = 0.5 * (low + high) + [rng.uniform(-0.2, 0.2) * (wide - 0.6), 0.05 * toward]
    half = np.array([wide / 2, max(rng.uniform(0.95, 1.08), (high[1] - low[1]) / 2 + 0.04)])
    if not couch:
        bed = make_bed(rng, level - 0.05, bare=True, size=(wide, 2 * half[1]))
        thing = Assembly(Kind.BED, random_albedo(rng, 0.05))
        thing.add(bed, float(middle[0]), 0.0, float(middle[1]), 0.0 if toward < 0 else np.pi)
    else:
        thing = _couch(rng, middle, half, level)
    plane = _flat(middle - half, middle + half, level)
    rest = sunk + _raised_back(figure, plane) + _pillow(figure, rng, plane)
    vertices = figure.vertices.astype(np.float64)
    surface = press(plane, rest, vertices, figure.faces, rng.uniform(0.5, 2.0))
    thing.sheet(with_sides(plane.points(surface), np.array([0.0, -0.18, 0.0])))
    if rng.random() < _BLANKETS:
        figure = _blanket(figure, rng, thing, plane, surface, toward)
    return Settled(figure, (thing,))


def _couch(rng: np.random.Generator, middle: Array, half: Array, level: float) -> Assembly:
    """Make a sofa without its seat, its back along x, for a person to lie on."""
    thing, side = Assembly(Kind.SOFA, random_albedo(rng, 0.05)), float(rng.choice([-1, 1]))
    (x, z), back, arm = middle, rng.uniform(0.3, 0.45), rng.uniform(0.1, 0.22)
    thing.box((x, level / 2 - 0.05, z), (2 * half[0], level - 0.1, 2 * half[1]))
    thing.box((x + side * (half[0] + 0.1), (level + back) / 2, z), (0.2, level + back, 2 * half[1] + 2 * arm))
    for end in (-1, 1):
        at = (x, level / 2 + 0.08, z + end * (half[1] + arm / 2))
        thing.box(at, (2 * half[0], level + 0.16, arm))
    return thing


def _raised_back(figure: Figure, plane: Plane) -> Array:
    """Return the elevation of a bed's head end under a half-seated person, (rows, columns)."""
    pelvis, chest, neck = _joints(figure, "pelvis", "chest", "neck")
    along = plane.origin[2] + CELL_M * np.arange(plane.shape[0])
    run = (along - pelvis[2]) * (1.0 if neck[2] > pelvis[2] else -1.0)
    rise = (chest[1] - pelvis[1]) / max(abs(float(chest[2] - pelvis[2])), 0.05)
    slope = float(np.clip(rise, 0.0, 1.5)) if rise > 0.15 else 0.0
    return np.asarray(np.broadcast_to((slope * np.clip(run, 0.0, 0.75))[:, None], plane.shape))


def _pillow(figure: Figure, rng: np.random.Generator, plane: Plane) -> Array:
    """Return the height of a pillow above the mattress, (rows, columns)."""
    if rng.random() < 0.15:
        return np.zeros(plane.shape)
    head = _joints(figure, "head")[0]
    half = rng.uniform((0.16, 0.24), (0.26, 0.42))
    spot = np.array([head[2], head[0]]) + rng.normal(0, 0.06, 2)
    at = plane.points(np.zeros(plane.shape))[..., [2, 0]]
    off = np.clip(np.abs(at - spot) / half, 0.0, 1.0) ** 3
    return np.asarray(rng.uniform(0.06, 0.17) * (1 - off[..., 0]) * (1 - off[..., 1]))


def _blanket(
    figure: Figure, rng: np.random.Generator, thing: Assembly, plane: Plane, rest: Array, toward: float
) -> Figure:
    """Cover a lying figure from the feet up, or only a part; return it with its cover."""
    pelvis, neck = _joints(figure, "pelvis", "neck")
    edge = pelvis[2] + rng.uniform(-0.35, 1.0) * (neck[2] - pelvis[2])
    row = int(np.clip((edge - plane.origin[2]) / CELL_M, 1, plane.shape[0] - 2))
    rows = slice(0, row + 1) if toward > 0 else slice(row, plane.shape[0])
    columns = slice(0, plane.shape[1])
    if rng.random() < 0.25:  # thrown half aside
        cut = int(rng.uniform(0.3, 0.7) * plane.shape[1])
        columns = slice(0, cut + 1) if rng.random() < 0.5 else slice(cut, plane.shape[1])
    part = Plane(
        plane.origin + CELL_M * (rows.start * plane.axes[0] + columns.start * plane.axes[1]),
        plane.axes,
        rest[rows, columns].shape,
    )
    laid = cover(rng, part, rest[rows, columns], figure.vertices.astype(np.float64), figure.faces)
    hang = np.array([0.0, -rng.uniform(0.02, 0.3) if figure.seat_height > 0 else 0.0, 0.0])
    thing.sheet(with_sides(laid.points, hang), albedo=random_albedo(rng, 0.1))
    return _covered(figure, [laid.person])


def _on_seat(figure: Figure, rng: np.random.Generator, what: str) -> Settled:
    """Make a figure's seat, and perhaps a table in front of it."""
    high = float(figure.seat_height)
    if what == "sofa":
        return _in_sofa(figure, rng)
    if what == "edge of a bed":
        thing = Assembly(Kind.BED)
        thing.add(make_bed(rng, high, bare=True), 0.0, 0.0, -0.3, np.pi / 2)
        return Settled(figure, (thing,))
    if what == "wheelchair":
        tilt, back = _backrest(figure)
        seat = make_wheelchair(rng, high, back - rng.uniform(-0.01, 0.03), float(np.clip(tilt, 0.03, 0.35)))
    else:
        seat = make_stool(rng, high) if what == "stool" else make_chair(rng, high, plain=True)
    if rng.random() > _DESKS:
        return Settled(figure, (seat,))
    make = make_desk if rng.random() < _LADEN else make_table
    desk, turned = make(rng, max(0.62, high + 0.27)), Assembly(Kind.TABLE)
    away = -float(desk.bounds()[0][2]) + rng.uniform(0.22, 0.4)
    turned.add(desk, 0.0, 0.0, away, np.pi)
    return Settled(figure, (seat, turned), away)


def _backrest(figure: Figure) -> tuple[float, float]:
    """Fit a backrest to a back: return its tilt (radians), and its contact with the seat (z, metres)."""
    spine, neck = _joints(figure, "spine", "neck")
    points = figure.vertices.astype(np.float64)
    strip = points[(np.abs(points[:, 0]) < _HALF_TRUNK_M) & (points[:, 1] < neck[1])]
    strip = strip[strip[:, 1] > figure.seat_height + 0.08]
    lean = float(np.clip(np.arctan2(spine[2] - neck[2], max(neck[1] - spine[1], 0.05)), 0.03, 0.6))
    depth = strip[:, 2] * np.cos(lean) + (strip[:, 1] - figure.seat_height) * np.sin(lean)
    return lean, float(depth.min(initial=0.0)) / np.cos(lean)


def _in_sofa(figure: Figure, rng: np.random.Generator) -> Settled:
    """Make an armchair or sofa with soft cushions for a figure that sits deep in it."""
    thing = Assembly(Kind.SOFA, random_albedo(rng, 0.05))
    lean, back = _backrest(figure)
    back += rng.uniform(-0.02, 0.09)  # the back lies this deep in the cushion
    sunk, high = rng.uniform(0.02, 0.12), float(figure.seat_height)
    wide = float(rng.choice([0.6, 1.3, 1.9]) * rng.uniform(0.9, 1.12))
    middle = rng.uniform(-0.5, 0.5) * max(wide - 0.6, 0.0)
    tall, thick, arm = rng.uniform(0.3, 0.75), rng.uniform(0.1, 0.25), rng.uniform(0.1, 0.25)
    front = _sofa_front(figure, back, rng)
    left, right = middle - wide / 2, middle + wide / 2
    vertices = figure.vertices.astype(np.float64)
    slope = rng.uniform(0.5, 2.0)

    seat = _flat(np.array([left, back]), np.array([right, front]), high + sunk)
    surface = press(seat, np.zeros(seat.shape), vertices, figure.faces, slope)
    thing.sheet(with_sides(seat.points(surface), np.array([0.0, -0.2, 0.0])))
    base = high + sunk - 0.18
    thing.box((middle, base / 2, (back + front) / 2), (wide, base, front - back))

    up, normal = np.array([0.0, np.cos(lean), -np.sin(lean)]), np.array([0.0, np.sin(lean), np.cos(lean)])
    axes = np.stack([up, [1.0, 0.0, 0.0], normal])
    shape = (int(tall / CELL_M) + 2, int(wide / CELL_M) + 2)
    rest = Plane(np.array([left, high, back]), axes, shape)
    bulge = rng.uniform(0.0, 0.04) * np.sin(np.pi * np.linspace(0, 1, shape[0]))[:, None]
    pressed = press(rest, np.broadcast_to(bulge, shape), vertices, figure.faces, slope)
    thing.sheet(with_sides(rest.points(pressed), -0.5 * thick * normal))
    frame = np.array([middle, high, back]) + 0.5 * tall * up - (0.12 + 0.5 * thick) * normal
    thing.box(frame, (wide + 2 * arm, tall + 0.05, thick), 0.0, -lean)
    thing.box((middle, high / 2, back - 0.5 * thick), (wide + 2 * arm, high, thick + 0.1))

    top = high + sunk + rng.uniform(0.1, 0.25)
    for side in (-1, 1):
        x = middle + side * (wide + arm) / 2
        thing.box((x, top / 2, (back + front) / 2), (arm, top, front - back))
        if rng.random() < 0.5:
            thing.bar((x, top, back), (x, top, front), arm * 0.55)
        if rng.random() < 0.4 and wide > 1.0:
            at = (middle + side * 0.4 * wide, high + sunk + 0.17, back + 0.12)
            thing.lump(at, (0.22, 0.2, 0.09), 0.05, rng.normal(0, 0.2), None, random_albedo(rng))
    if rng.random() < _LAP_BLANKETS:
        figure = _lap_blanket(figure, rng, thing, seat, surface)
    return Settled(figure, (thing,))


def _sofa_front(figure: Figure, back: float, rng: np.random.Generator) -> float:
    """Return the z of a seat's front edge, which is before the shanks, metres."""
    points = figure.vertices[figure.vertices[:, 1] < figure.seat_height - 0.1]
    shanks = float(np.quantile(points[:, 2], 0.02)) if len(points) else 0.3
    return max(min(back + rng.uniform(0.5, 0.7), shanks - 0.01), back + 0.3)


def _lap_blanket(
    figure: Figure, rng: np.random.Generator, thing: Assembly, seat: Plane, surface: Array
) -> Figure:
    """Lay a blanket over the thighs of a seated figure; return the figure with it."""
    knees = _joints(figure, "left_knee", "right_knee")
    first = int(np.clip((rng.uniform(0.0, 0.15) - seat.origin[2]) / CELL_M, 0, seat.shape[0] - 3))
    ahead = int(max(knees[:, 2].max() + 0.1 - seat.origin[2], 0.0) / CELL_M)
    rows = max(ahead - first, 3)
    part = replace(seat, origin=seat.origin + CELL_M * first * seat.axes[0], shape=(rows, seat.shape[1]))
    below = np.full(part.shape, -0.12)
    shared = min(rows, seat.shape[0] - first)
    below[:shared] = surface[first : first + shared]
    # the trunk and the arms above the lap stay out
    legs = figure.faces[(figure.vertices[figure.faces, 1].max(axis=1) < figure.seat_height + 0.24)]
    laid = cover(rng, part, below, figure.vertices.astype(np.float64), legs)
    thing.sheet(with_sides(laid.points, np.array([0.0, -rng.uniform(0.05, 0.3), 0.0])))
    return _covered(figure, [laid.person])
