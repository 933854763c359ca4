"""Shapes of objects in rooms, and their triangles.

An object is an `Assembly` of boxes, cylinders, lumps and sheets, made at the origin of its own floor
(metres, x to the right, y up, z to the front) and then moved to its place. The shapes of one scene
are turned into triangles together (`triangulate`), because one by one would take longer than drawing
them. Every triangle has the kind of its object and its infrared reflectance: black plastic and screens
near 0, white paint near 1.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from depth_pose.sim._meshes import grid_faces

Array = NDArray[np.float64]


class Kind(IntEnum):
    """Kind of object at a pixel of a simulated scene."""

    NOTHING = 0
    PERSON = 1
    HELD = 2
    FLOOR = 3
    WALL = 4
    CEILING = 5
    TABLE = 6
    CHAIR = 7
    STOOL = 8
    SOFA = 9
    BED = 10
    SHELF = 11
    DOOR = 12
    MONITOR = 13
    CLUTTER = 14
    PLANT = 15
    BOX = 16
    CURTAIN = 17
    PILLAR = 18
    COATS = 19
    LAMP = 20
    BIN = 21
    PIPE = 22
    BOARD = 23
    AID = 24
    PET = 25


_LUMP_RINGS, _LUMP_COLUMNS = 7, 12
"""Points of a lump from pole to pole and around."""
_ROUND_COLUMNS = 12
"""Points around a cylinder."""
_BOX_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
"""Corners of a box with edges of 1, (8, 3)."""
_BOX_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip
"""Triangles of a box, by `_BOX_CORNERS`, (12, 3)."""


def _lump_template() -> tuple[Array, NDArray[np.int64]]:
    polar = np.linspace(0.0, np.pi, _LUMP_RINGS)[:, None]
    around = 2 * np.pi * np.arange(_LUMP_COLUMNS)[None] / _LUMP_COLUMNS
    points = np.stack(
        [np.sin(polar) * np.cos(around), np.cos(polar) + 0 * around, np.sin(polar) * np.sin(around)], axis=-1
    )
    return points.reshape(-1, 3), grid_faces(_LUMP_RINGS, _LUMP_COLUMNS, closed=True).astype(np.int64)


_LUMP, _LUMP_FACES = _lump_template()


def _round_template() -> tuple[Array, Array, NDArray[np.int64]]:
    """Return a cylinder: directions of the rim, the end (0 or 1) of each corner, faces with both lids."""
    n = _ROUND_COLUMNS
    around = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    fan = np.arange(1, n - 1)
    lid = np.stack([0 * fan, fan, fan + 1], axis=1)
    faces = np.concatenate([grid_faces(2, n, closed=True), lid, lid + n])
    return np.concatenate([ring, ring]), np.repeat([0.0, 1.0], n), faces


_ROUND, _ROUND_END, _ROUND_FACES = _round_template()


@dataclass(frozen=True)
class Triangles:
    """A scene's surfaces.

    Attributes
    ----------
    vertices : (V, 3) float64
        Room frame, y up, metres.
    faces : (F, 3) int64
    kind : (F,) uint8
        `Kind` of each triangle.
    albedo : (F,) float32
        Infrared reflectance of a triangle, 0 to 1.
    """

    vertices: Array
    faces: NDArray[np.int64]
    kind: NDArray[np.uint8]
    albedo: NDArray[np.float32]


class Assembly:
    """Shapes that belong together, in the frame of their own floor.

    Parameters
    ----------
    kind : Kind
        Default for its shapes.
    albedo : float
        Likewise.
    """

    def __init__(self, kind: Kind, albedo: float = 0.6) -> None:
        self._kind, self._albedo = kind, albedo
        self.boxes: list[tuple[float, ...]] = []
        self.rounds: list[tuple[float, ...]] = []
        self.lumps: list[tuple[float, ...]] = []
        self.sheets: list[tuple[Array, bool, int, float]] = []

    def box(
        self,
        at: Iterable[float],
        size: Iterable[float],
        turn: float = 0.0,
        tilt: float = 0.0,
        kind: Kind | None = None,
        albedo: float | None = None,
    ) -> None:
        """Add a box by its centre and edges; tilted about its x axis, then turned about y, radians."""
        self.boxes.append((*at, *size, turn, tilt, *self._look(kind, albedo)))

    def bar(
        self,
        start: Iterable[float],
        end: Iterable[float],
        radius: float,
        end_radius: float | None = None,
        kind: Kind | None = None,
        albedo: float | None = None,
    ) -> None:
        """Add a cylinder or cone between two points."""
        wide = radius if end_radius is None else end_radius
        self.rounds.append((*start, *end, radius, wide, *self._look(kind, albedo)))

    def lump(
        self,
        at: Iterable[float],
        radii: Iterable[float],
        roughness: float = 0.1,
        turn: float = 0.0,
        kind: Kind | None = None,
        albedo: float | None = None,
    ) -> None:
        """Add an uneven ellipsoid by its centre and radii."""
        self.lumps.append((*at, *radii, turn, roughness, *self._look(kind, albedo)))

    def sheet(self, points: Array, wraps: bool = False, albedo: float | None = None) -> None:
        """Add a surface through a grid of points (rows, columns, 3); one that wraps is a tube."""
        number, share = self._look(None, albedo)
        self.sheets.append((points, wraps, int(number), share))

    def _look(self, kind: Kind | None, albedo: float | None) -> tuple[float, float]:
        return float(self._kind if kind is None else kind), self._albedo if albedo is None else albedo

    def add(self, other: Assembly, x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: float = 0.0) -> None:
        """Add the shapes of another, rotated about y (radians) and then moved."""
        c, s = float(np.cos(turn)), float(np.sin(turn))

        def moved(px: float, py: float, pz: float) -> tuple[float, float, float]:
            return c * px + s * pz + x, py + y, c * pz - s * px + z

        self.boxes += [(*moved(*b[:3]), *b[3:6], b[6] + turn, *b[7:]) for b in other.boxes]
        self.rounds += [(*moved(*b[:3]), *moved(*b[3:6]), *b[6:]) for b in other.rounds]
        self.lumps += [(*moved(*b[:3]), *b[3:6], b[6] + turn, *b[7:]) for b in other.lumps]
        turned = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        self.sheets += [(p @ turned.T + np.array([x, y, z]), *rest) for p, *rest in other.sheets]

    def repaint(self, albedo: float) -> None:
        """Give another reflectance to the shapes of its default one; those of their own keep theirs."""

        def painted(row: tuple[float, ...]) -> tuple[float, ...]:
            return (*row[:-1], albedo) if row[-1] == self._albedo else row

        self.boxes = [painted(row) for row in self.boxes]
        self.rounds = [painted(row) for row in self.rounds]
        self.lumps = [painted(row) for row in self.lumps]
        self.sheets = [(*s[:3], albedo) if s[3] == self._albedo else s for s in self.sheets]
        self._albedo = albedo

    def bounds(self) -> tuple[Array, Array]:
        """Approximate least and greatest x, y, z of the shapes: rotations and tilts are ignored."""
        low, high = [np.zeros((0, 3))], [np.zeros((0, 3))]
        for rows, reach in ((self.boxes, 0.5), (self.lumps, 1.0)):
            if rows:
                table = np.array(rows)
                low.append(table[:, :3] - reach * table[:, 3:6])
                high.append(table[:, :3] + reach * table[:, 3:6])
        if self.rounds:
            table = np.array(self.rounds)
            wide = table[:, 6:8].max(axis=1, keepdims=True) * np.array([1.0, 0.0, 1.0])
            low.append(np.minimum(table[:, :3], table[:, 3:6]) - wide)
            high.append(np.maximum(table[:, :3], table[:, 3:6]) + wide)
        for points, *_ in self.sheets:
            low.append(points.reshape(-1, 3).min(axis=0, keepdims=True))
            high.append(points.reshape(-1, 3).max(axis=0, keepdims=True))
        return np.concatenate(low).min(axis=0), np.concatenate(high).max(axis=0)


def joined(parts: Sequence[Triangles]) -> Triangles:
    """Combine surfaces."""
    first = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    return Triangles(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate([p.faces + start for p, start in zip(parts, first, strict=True)]),
        np.concatenate([p.kind for p in parts]),
        np.concatenate([p.albedo for p in parts]),
    )


def triangulate(assembly: Assembly, rng: np.random.Generator) -> Triangles:
    """Convert all shapes to triangles; `rng` makes the lumps uneven."""
    parts = [
        _box_triangles(assembly.boxes),
        _round_triangles(assembly.rounds),
        _lump_triangles(assembly.lumps, rng),
    ]
    for points, wraps, kind, albedo in assembly.sheets:
        grid = grid_faces(points.shape[0], points.shape[1], wraps).astype(np.int64)
        parts.append((points.reshape(-1, 3), grid, np.array([[kind, albedo]]), len(grid)))
    vertices, faces, looks, first = [], [], [], 0
    for points, part_faces, look, repeats in parts:
        vertices.append(points)
        faces.append(part_faces + first)
        looks.append(np.repeat(look, repeats, axis=0))
        first += len(points)
    look = np.concatenate(looks)
    return Triangles(
        np.concatenate(vertices),
        np.concatenate(faces),
        look[:, 0].astype(np.uint8),
        look[:, 1].astype(np.float32),
    )


_Part = tuple[Array, NDArray[np.int64], Array, int]


def _shapes(points: Array, template: NDArray[np.int64], looks: Array) -> _Part:
    """Combine equal shapes with corners (N, V, 3)."""
    first = points.shape[1] * np.arange(len(points))[:, None, None]
    return points.reshape(-1, 3), (first + template).reshape(-1, 3), looks, len(template)


def _table(rows: list[tuple[float, ...]]) -> Array:
    return np.array(rows, np.float64).reshape(len(rows), 10)


def _turned(points: Array, turn: Array) -> Array:
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack([c * x + s * z, y, c * z - s * x], axis=-1)


def _box_triangles(rows: list[tuple[float, ...]]) -> _Part:
    table = _table(rows)
    points = _BOX_CORNERS * table[:, None, 3:6]
    c, s = np.cos(table[:, 7])[:, None], np.sin(table[:, 7])[:, None]
    tilted = np.stack(
        [points[..., 0], c * points[..., 1] - s * points[..., 2], s * points[..., 1] + c * points[..., 2]],
        axis=-1,
    )
    return _shapes(_turned(tilted, table[:, 6]) + table[:, None, :3], _BOX_FACES, table[:, 8:])


def _round_triangles(rows: list[tuple[float, ...]]) -> _Part:
    table = _table(rows)
    start, end = table[:, None, :3], table[:, None, 3:6]
    along = table[:, 3:6] - table[:, :3]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    helper = np.where(np.abs(along[:, 1:2]) > 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    one = np.cross(along, helper)
    one /= np.maximum(np.linalg.norm(one, axis=1, keepdims=True), 1e-9)
    two = np.cross(along, one)
    radius = table[:, 6:7] + (table[:, 7:8] - table[:, 6:7]) * _ROUND_END
    out = _ROUND[:, 0, None] * one[:, None] + _ROUND[:, 1, None] * two[:, None]
    points = start + (end - start) * _ROUND_END[:, None] + radius[..., None] * out
    return _shapes(points, _ROUND_FACES, table[:, 8:])


def _lump_triangles(rows: list[tuple[float, ...]], rng: np.random.Generator) -> _Part:
    table = _table(rows)
    swell = rng.standard_normal((len(table), _LUMP_RINGS, _LUMP_COLUMNS)).clip(-2, 2)
    swell[:, [0, -1]] = 0.0  # a pole is one point
    scale = 1.0 + table[:, 7, None] * swell.reshape(len(table), len(_LUMP))
    points = _LUMP * scale[..., None] * table[:, None, 3:6]
    return _shapes(_turned(points, table[:, 6]) + table[:, None, :3], _LUMP_FACES, table[:, 8:])


def random_albedo(rng: np.random.Generator, dark: float = 0.15) -> float:
    """Sample the reflectance of an object; a share of `dark` of all objects is nearly black."""
    return float(rng.uniform(0.02, 0.12) if rng.random() < dark else rng.uniform(0.25, 0.9))
