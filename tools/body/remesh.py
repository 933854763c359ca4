"""Even triangulation of half a body, and its mirroring into a whole one.

Incremental remeshing after M. Botsch and L. Kobbelt, *A remeshing approach to multiresolution
modeling*, SGP 2004: collapse short edges, flip edges towards even valence, move vertices along
the surface; here from a fine mesh downwards, so that no edge needs splitting. The open border of
the half lies in the mirror plane x = 0 and stays there.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.normals import vertex_normals
from surface import Array, Field, Mesh

_GRADIENT_STEP = 1e-4
"""Half-width of central differences of the field, metres."""
_NEWTON_STEP_M = 0.01
"""Longest step onto the surface, metres. Set by hand."""
_LEAST_SLOPE2 = 0.05
"""Least squared slope that a step divides by: where parts blend the field is no distance."""

Point = tuple[float, float, float]


def remesh_half(mesh: Mesh, field: Field, edge_length: Callable[[Array], Array], rounds: int = 4) -> Mesh:
    """Coarsen a half mesh to edges of about the wished length.

    Parameters
    ----------
    mesh : Mesh
        Fine mesh of the part x >= 0; its border lies at x = 0.
    field : callable
        The signed distance whose surface the vertices stay on; symmetric in x.
    edge_length : callable
        Wished edge length (N,) at points (N, 3), metres.
    rounds : int
        Repetitions of collapse, flip and smoothing.
    """
    for _ in range(rounds):
        work = _Topology(mesh, edge_length(mesh.vertices))
        work.collapse()
        work.flip()
        mesh = work.result()
        for _ in range(3):
            mesh = Mesh(project(_relax(mesh), field, mesh), mesh.faces)
    return mesh


def mirror(half: Mesh) -> Mesh:
    """Join a half mesh and its mirror image; vertices on x = 0 are shared.

    The left half's vertices come first, then the images of those off the plane in the same order.
    """
    border = half.vertices[:, 0] == 0.0
    image = np.arange(len(half.vertices))
    image[~border] = len(half.vertices) + np.arange(int((~border).sum()))
    vertices = np.concatenate([half.vertices, half.vertices[~border] * [-1.0, 1.0, 1.0]])
    faces = np.concatenate([half.faces, image[half.faces][:, ::-1]])
    return Mesh(vertices, faces.astype(np.int32))


def border_vertices(faces: NDArray[np.int32], count: int) -> NDArray[np.bool_]:
    """Which of `count` vertices lie on an open edge."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, times = np.unique(edges, axis=0, return_counts=True)
    border = np.zeros(count, dtype=bool)
    border[unique[times == 1].ravel()] = True
    return border


def gradient(field: Field, points: Array) -> Array:
    """Central differences of a field at (N, 3) points."""
    n = len(points)
    steps = _GRADIENT_STEP * np.concatenate([np.eye(3), -np.eye(3)])
    values = field((points[None] + steps[:, None]).reshape(-1, 3)).reshape(6, n)
    return (values[:3] - values[3:]).T / (2 * _GRADIENT_STEP)


def project(points: Array, field: Field, mesh: Mesh) -> Array:
    """Move points onto the field's zero level by two Newton steps; the border stays at x = 0."""
    border = border_vertices(mesh.faces, len(points))
    for _ in range(2):
        slope = gradient(field, points)
        slope[border, 0] = 0.0
        square = np.maximum((slope**2).sum(axis=1), _LEAST_SLOPE2)
        step = np.clip(field(points) / square, -_NEWTON_STEP_M, _NEWTON_STEP_M)
        points = points - step[:, None] * slope
        points[border, 0] = 0.0
    return points


def _relax(mesh: Mesh) -> Array:
    """Move each vertex half-way to the middle of its neighbours, along the surface."""
    n = len(mesh.vertices)
    border = border_vertices(mesh.faces, n)
    pairs = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    pairs = pairs[~border[pairs[:, 0]] | border[pairs[:, 1]]]
    total, count = np.zeros((n, 3)), np.zeros(n)
    np.add.at(total, pairs[:, 0], mesh.vertices[pairs[:, 1]])
    np.add.at(count, pairs[:, 0], 1.0)
    move = total / count[:, None] - mesh.vertices
    normals = vertex_normals(mesh)
    normals[border, 0] = 0.0
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    move -= (move * normals).sum(axis=1, keepdims=True) * normals
    moved: Array = mesh.vertices + 0.5 * move
    moved[border, 0] = 0.0
    return moved


class _Topology:
    """A triangle mesh that can be edited edge by edge."""

    def __init__(self, mesh: Mesh, sizes: Array) -> None:
        self.points: list[Point] = [tuple(p) for p in mesh.vertices.tolist()]
        self.sizes: list[float] = sizes.tolist()
        self.faces: list[list[int] | None] = mesh.faces.tolist()
        self.around: list[set[int]] = [set() for _ in self.points]
        for i, face in enumerate(mesh.faces.tolist()):
            for v in face:
                self.around[v].add(i)
        self.border: list[bool] = border_vertices(mesh.faces, len(self.points)).tolist()

    def result(self) -> Mesh:
        """Pack what is left."""
        faces = np.array([f for f in self.faces if f is not None], dtype=np.int64)
        used, packed = np.unique(faces, return_inverse=True)
        points = np.array([self.points[i] for i in used.tolist()])
        return Mesh(points, packed.reshape(faces.shape).astype(np.int32))

    def _face(self, i: int) -> list[int]:
        face = self.faces[i]
        assert face is not None
        return face

    def _neighbours(self, v: int) -> set[int]:
        return {u for i in self.around[v] for u in self._face(i)} - {v}

    def _length(self, a: int, b: int) -> float:
        p, q = self.points[a], self.points[b]
        length: float = ((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2) ** 0.5
        return length / (0.5 * (self.sizes[a] + self.sizes[b]))

    def _edges(self) -> list[tuple[int, int]]:
        found = set()
        for face in self.faces:
            if face is not None:
                for a, b in ((face[0], face[1]), (face[1], face[2]), (face[2], face[0])):
                    found.add((a, b) if a < b else (b, a))
        return sorted(found)

    def collapse(self, shortest: float = 0.8, longest: float = 1.35) -> None:
        """Collapse edges shorter than `shortest` wished lengths, the shortest first.

        None longer than `longest` may come of it; both are near Botsch and Kobbelt's 4/5 and 4/3.
        """
        heap = [(self._length(a, b), a, b) for a, b in self._edges()]
        heap = [e for e in heap if e[0] < shortest]
        heapq.heapify(heap)
        while heap:
            length, a, b = heapq.heappop(heap)
            if not self.around[a] or not self.around[b] or length != self._length(a, b):
                continue
            if not (self.around[a] & self.around[b]) or not self._merge(a, b, longest):
                continue
            for u in sorted(self._neighbours(a)):
                edge = self._length(a, u)
                if edge < shortest:
                    heapq.heappush(heap, (edge, min(a, u), max(a, u)))

    def _merge(self, a: int, b: int, longest: float) -> bool:
        """Collapse edge a, b into a where that keeps the surface sound."""
        shared = self.around[a] & self.around[b]
        if self.border[b] and not self.border[a]:
            at = self.points[b]
        elif self.border[a] and not self.border[b]:
            at = self.points[a]
        else:
            if self.border[a] and len(shared) != 1:
                return False
            p, q = self.points[a], self.points[b]
            at = (0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2]))
        if len(self._neighbours(a) & self._neighbours(b)) != len(shared):
            return False
        ring = (self.around[a] | self.around[b]) - shared
        if any(self._turns(i, (a, b), at) for i in ring):
            return False
        size = 0.5 * (self.sizes[a] + self.sizes[b])
        for u in self._neighbours(a) | self._neighbours(b):
            if u not in (a, b):
                q = self.points[u]
                far = ((at[0] - q[0]) ** 2 + (at[1] - q[1]) ** 2 + (at[2] - q[2]) ** 2) ** 0.5
                if far > longest * 0.5 * (size + self.sizes[u]):
                    return False
        for i in shared:
            for v in self._face(i):
                self.around[v].discard(i)
            self.faces[i] = None
        for i in self.around[b]:
            face = self._face(i)
            face[face.index(b)] = a
        self.around[a] |= self.around[b]
        self.around[b] = set()
        self.points[a], self.sizes[a] = at, size
        self.border[a] = self.border[a] or self.border[b]
        return True

    def _turns(self, i: int, moved: tuple[int, ...], at: Point) -> bool:
        """Whether a face would turn by more than about 60 degrees, or vanish."""
        face = self._face(i)
        before = _normal(*(self.points[v] for v in face))
        after = _normal(*(at if v in moved else self.points[v] for v in face))
        dot = sum(x * y for x, y in zip(before, after, strict=True))
        sizes = sum(x * x for x in before) * sum(x * x for x in after)
        return dot <= 0.5 * sizes**0.5 or sizes == 0.0

    def flip(self) -> None:
        """Flip edges where that brings the valences nearer to 6 (4 on the border)."""
        for a, b in self._edges():
            shared = sorted(self.around[a] & self.around[b])
            if len(shared) != 2:
                continue
            c, d = ((set(self._face(i)) - {a, b}).pop() for i in shared)
            if d in self._neighbours(c):
                continue
            before = sum(abs(self._excess(v)) for v in (a, b, c, d))
            after = sum(abs(self._excess(v) + s) for v, s in ((a, -1), (b, -1), (c, 1), (d, 1)))
            if after < before:
                self._flip(a, b, c, d, shared)

    def _excess(self, v: int) -> int:
        if self.border[v]:
            return len(self.around[v]) + 1 - 4
        return len(self.around[v]) - 6

    def _flip(self, a: int, b: int, c: int, d: int, shared: list[int]) -> None:
        first = self._face(shared[0])
        if first[(first.index(a) + 1) % 3] != b:
            a, b = b, a
        new = [[c, a, d], [d, b, c]]
        old = [_normal(*(self.points[v] for v in self._face(i))) for i in shared]
        for face in new:
            normal = _normal(*(self.points[v] for v in face))
            for other in old:
                dot = sum(x * y for x, y in zip(normal, other, strict=True))
                sizes = sum(x * x for x in normal) * sum(x * x for x in other)
                if dot <= 0.7 * sizes**0.5 or sizes == 0.0:
                    return
        for i, face in zip(shared, new, strict=True):
            for v in self._face(i):
                self.around[v].discard(i)
            self.faces[i] = face
        for i, face in zip(shared, new, strict=True):
            for v in face:
                self.around[v].add(i)


def _normal(p: Point, q: Point, r: Point) -> Point:
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    return (uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)
