"""Implicit surfaces: sweeps and ellipsoids, blended smoothly, and a mesher for them.

A surface is a function that gives the (approximately Euclidean) signed distance of points,
negative inside. Parts are blended by the polynomial smooth minimum

    smin(a, b, k) = min(a, b) - h^2 k / 4,   h = max(k - |a - b|, 0) / k

and meshed by surface nets: one vertex per grid cell that the surface passes, at the mean of
the crossings on the cell's edges (S. F. Gibson, *Constrained elastic surface nets*, MICCAI 1998).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]
Field = Callable[[Array], Array]

_COARSE = 4
"""Nodes along each axis that share one sample far from the surface."""


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh.

    Attributes
    ----------
    vertices : (V, 3) float64
        Positions, metres.
    faces : (F, 3) int32
        Vertex indices, counter-clockwise seen from outside.
    """

    vertices: Array
    faces: NDArray[np.int32]


def smooth_min(a: Array, b: Array, k: float) -> Array:
    """Blend two signed distances over a width of `k` metres (union)."""
    h = np.maximum(k - np.abs(a - b), 0.0) / k
    return np.minimum(a, b) - 0.25 * k * h * h


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid as a signed distance.

    Attributes
    ----------
    centre : (3,)
        Metres.
    radii : (3,)
        Half-axes along the columns of `axes`, metres.
    axes : (3, 3)
        Its axes as columns.
    """

    centre: Array
    radii: Array
    axes: Array

    def __call__(self, points: Array) -> Array:
        """Signed distance of (N, 3) points, first order at the surface."""
        local = (points - self.centre) @ self.axes
        k0 = np.linalg.norm(local / self.radii, axis=1)
        k1 = np.linalg.norm(local / self.radii**2, axis=1)
        inner = -float(np.min(self.radii))
        return np.where(k0 > 1e-6, k0 * (k0 - 1.0) / np.maximum(k1, 1e-9), inner)


class Sweep:
    """A tube along a straight axis whose cross-section changes from station to station.

    A cross-section at distance t along the axis is a superellipse, with its own half-axes to
    both sides, front and back of the axis: ``|s / a|^n + |f / b|^n = 1``. Between stations
    the half-axes follow monotone cubic splines.

    Parameters
    ----------
    start, end : (3,)
        Ends of the axis, metres.
    front : (3,)
        Direction that counts as front; made perpendicular to the axis.
    stations : (S, 5 or 6)
        Rows ``t, side, other side, front, back[, n]``; t is a fraction of the axis, the half-axes
        are metres, and the exponent n is 2 if not given. The first side is along axis x front.
    """

    def __init__(self, start: Array, end: Array, front: Array, stations: Array) -> None:
        axis = end - start
        self.length = float(np.linalg.norm(axis))
        self.axis = axis / self.length
        side = np.cross(self.axis, front)
        self.side = side / np.linalg.norm(side)
        self.front = np.cross(self.side, self.axis)
        self.start = start
        if stations.shape[1] == 5:
            stations = np.column_stack([stations, np.full(len(stations), 2.0)])
        self.low, self.high = float(stations[0, 0]), float(stations[-1, 0])
        self.spline = PchipInterpolator(stations[:, 0], stations[:, 1:], axis=0)

    def __call__(self, points: Array) -> Array:
        """Signed distance of (N, 3) points, approximate."""
        v = points - self.start
        along = v @ self.axis
        s, f = v @ self.side, v @ self.front
        t = np.clip(along / self.length, self.low, self.high)
        left, right, front, back, n = self.spline(t).T
        a, b = np.where(s > 0, left, right), np.where(f > 0, front, back)
        r = (np.abs(s / a) ** n + np.abs(f / b) ** n) ** (1.0 / n)
        reach = np.hypot(s, f)
        small = np.minimum(a, b)
        radial = np.where(r > 1e-6, reach * (1.0 - 1.0 / np.maximum(r, 1e-6)), -small)
        beyond = np.maximum(self.low * self.length - along, along - self.high * self.length)
        outside = np.hypot(np.maximum(radial, 0.0), np.maximum(beyond, 0.0))
        distance: Array = outside + np.minimum(np.maximum(radial, beyond), 0.0)
        return distance


def surface_nets(values: Array, origin: Array, spacing: float) -> Mesh:
    """Mesh the zero level of a sampled signed distance.

    Parameters
    ----------
    values : (X, Y, Z)
        Signed distance at the grid nodes; must be positive on the grid's border.
    origin : (3,)
        Position of node (0, 0, 0), metres.
    spacing : float
        Grid step, metres.
    """
    inside = values < 0
    cells = tuple(n - 1 for n in values.shape)
    total = np.zeros((*cells, 3))
    count = np.zeros(cells)
    for axis in range(3):
        lo = np.take(values, np.arange(cells[axis]), axis)
        hi = np.take(values, np.arange(1, cells[axis] + 1), axis)
        crossed = (lo < 0) != (hi < 0)
        t = np.where(crossed, lo / np.where(crossed, lo - hi, 1.0), 0.0)
        others = [k for k in range(3) if k != axis]
        for du in (0, 1):
            for dv in (0, 1):
                pick: list[slice] = [slice(None)] * 3
                pick[others[0]] = slice(du, du + cells[others[0]])
                pick[others[1]] = slice(dv, dv + cells[others[1]])
                c, tt = crossed[tuple(pick)], t[tuple(pick)]
                count += c
                total[..., axis] += c * tt
                total[..., others[0]] += c * du
                total[..., others[1]] += c * dv
    used = count > 0
    index = np.full(cells, -1, dtype=np.int64)
    index[used] = np.arange(int(used.sum()))
    where = np.argwhere(used)
    vertices = origin + spacing * (where + total[used] / count[used][:, None])
    faces: list[NDArray[np.int64]] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        a = np.take(inside, np.arange(cells[axis]), axis)
        b = np.take(inside, np.arange(1, cells[axis] + 1), axis)
        edges = np.argwhere(a != b)
        leaves = a[tuple(edges.T)]
        e_u, e_v = np.eye(3, dtype=np.int64)[u], np.eye(3, dtype=np.int64)[v]
        quad = np.stack([index[tuple((edges + d).T)] for d in (-e_u - e_v, -e_v, 0 * e_u, -e_u)], axis=1)
        quad = np.where(leaves[:, None], quad, quad[:, ::-1])
        diag = np.linalg.norm(vertices[quad[:, 0]] - vertices[quad[:, 2]], axis=1) <= np.linalg.norm(
            vertices[quad[:, 1]] - vertices[quad[:, 3]], axis=1
        )
        faces.append(np.where(diag[:, None], quad[:, [0, 1, 2]], quad[:, [1, 2, 3]]))
        faces.append(np.where(diag[:, None], quad[:, [0, 2, 3]], quad[:, [1, 3, 0]]))
    return Mesh(vertices, np.concatenate(faces).astype(np.int32))


def sample_grid(field: Field, low: Array, counts: tuple[int, int, int], spacing: float) -> Array:
    """Signed distances at the nodes of a regular grid, exact only near the surface.

    Every `_COARSE`-th node is sampled first; nodes far from the surface keep its coarse value.

    Parameters
    ----------
    field : callable
        Signed distance of (N, 3) points.
    low : (3,)
        Position of node (0, 0, 0), metres.
    counts : (3,) of int
        Number of nodes along each axis.
    spacing : float
        Grid step, metres.
    """
    coarse = [-(-n // _COARSE) for n in counts]
    step = spacing * _COARSE
    nodes = _grid_nodes(low + 0.5 * (step - spacing), coarse, step)
    rough = field(nodes.reshape(-1, 3)).reshape(coarse)
    values = rough.repeat(_COARSE, 0).repeat(_COARSE, 1).repeat(_COARSE, 2)
    values = np.ascontiguousarray(values[: counts[0], : counts[1], : counts[2]])
    near = np.abs(values) < 1.6 * step
    values[near] = field(_grid_nodes(low, counts, spacing)[near])
    return values


def _grid_nodes(low: Array, counts: Sequence[int], spacing: float) -> Array:
    axes = [low[k] + spacing * np.arange(counts[k]) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
