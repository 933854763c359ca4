"""Compiled sums over the skin for personal builds; `depth_pose.refine.personal` derives them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from depth_pose.body._skin_kernels import skin
from depth_pose.core._camera_kernels import project, ray
from depth_pose.core._raster_kernels import NEAR_M, rasterize
from depth_pose.core.kernels import njit
from depth_pose.refine._articulated_kernels import assign
from depth_pose.refine._visibility_kernels import mark_visible, turn_normals

_LEAST_MASS = 1e-3
"""Vertices with less responsibility than this are ignored."""

_BEHIND_M = 0.05
"""A vertex is visible if it lies at most this far (m) behind the rendered depth."""


class Shapes(NamedTuple):
    """Derivatives of the rest pose by the build parameters: vertices (V, 3, K), nodes (21, 3, K), metres."""

    vertices: Any
    nodes: Any


class Pose(NamedTuple):
    """Rotations (21, 3, 3), root (3,) and scale of a posed body."""

    rotations: Any
    root: Any
    scale: float


class Model(NamedTuple):
    """A posed body with the derivatives of its nodes by the build parameters, (21, 3, K)."""

    skin: Any
    shapes: Any
    pose: Any
    shifts: Any


class Sums(NamedTuple):
    """Sums over the residuals.

    Attributes
    ----------
    motion : (21, 6, 8 + K) float64
        For each segment's free motion ``w x (v - root) + t``: products with itself, with the logarithm
        of the size, with the build, and with the residual.
    build : (1 + K, 2 + K) float64
        For size and build: products with themselves, and with the residual.
    """

    motion: Any
    build: Any


@njit(cache=True)
def add_up(target, body, shapes, pose, settings, sigma, nodes, sums):
    """Sum the products of all residual derivatives at a pose; ``nodes`` (21, 3) is written as well."""
    coarse, count = target.coarse, body.normals.shape[0]
    vertices, normals, visible = np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.bool_)
    mass, pull, zbuffer = np.empty(count), np.empty((count, 3)), np.empty(coarse.depth.shape, np.float32)
    skin(body.skin, pose.rotations, pose.root, pose.scale, vertices, nodes)
    turn_normals(body.normals, body.skin.influence, pose.rotations, normals)
    rasterize(vertices, body.skin.faces, coarse.camera, zbuffer)
    mark_visible(vertices, normals, zbuffer, coarse.camera, _BEHIND_M, visible)
    stride = np.int64(1)  # not the literal, for which the kernel would be compiled once more
    assign(target.points, stride, vertices, visible, sigma, settings.outlier, mass, pull)
    model = Model(body.skin, shapes, pose, _node_shifts(body.skin.parents, shapes, pose))
    row = np.empty(8 + shapes.nodes.shape[2])
    normal = np.empty(3)
    for i in range(count):
        if mass[i] >= _LEAST_MASS:
            r = 0.0
            for a in range(3):
                normal[a] = normals[i, a]
                r += normal[a] * pull[i, a] / mass[i]
            _fill_row(i, vertices, normal, r, model, row)
            _add_row(row, mass[i], body.skin.influence[i, 0], sums)
        if i % 2 == 0:
            r = _free_space(vertices[i], target, settings, normal)
            if r > 0.0:
                _fill_row(i, vertices, normal, r, model, row)
                _add_row(row, 2.0 * settings.free_space_weight, body.skin.influence[i, 0], sums)


@njit(cache=True)
def _node_shifts(parents, shapes, pose):
    """Compute the derivatives of the nodes by the build parameters, (21, 3, K), metres."""
    out = np.zeros(shapes.nodes.shape)
    for n in range(1, parents.shape[0]):
        p = parents[n]
        for a in range(3):
            for k in range(out.shape[2]):
                out[n, a, k] = out[p, a, k]
            for b in range(3):
                turned = pose.scale * pose.rotations[p, a, b]
                for k in range(out.shape[2]):
                    out[n, a, k] += turned * (shapes.nodes[n, b, k] - shapes.nodes[p, b, k])
    return out


@njit(cache=True, fastmath=True, forceinline=True)
def _fill_row(i, vertices, normal, r, model, row):
    """Write a vertex's derivatives along a direction by segment motion, size and build, and its residual."""
    shapes, pose, shifts = model.shapes, model.pose, model.shifts
    root = pose.root
    x, y, z = vertices[i, 0] - root[0], vertices[i, 1] - root[1], vertices[i, 2] - root[2]
    row[0] = y * normal[2] - z * normal[1]
    row[1] = z * normal[0] - x * normal[2]
    row[2] = x * normal[1] - y * normal[0]
    row[3], row[4], row[5] = normal[0], normal[1], normal[2]
    row[6] = x * normal[0] + y * normal[1] + z * normal[2]
    parts = shapes.nodes.shape[2]
    row[7:] = 0.0
    row[7 + parts] = r
    influence, weight = model.skin.influence[i], model.skin.weight[i]
    for j in range(influence.shape[0]):
        w = weight[j]
        if w == 0.0:
            break
        n = influence[j]
        turn = pose.rotations[n]
        for b in range(3):
            # the direction in the rest frame of the segment
            back = turn[0, b] * normal[0] + turn[1, b] * normal[1] + turn[2, b] * normal[2]
            back *= w * pose.scale
            ahead = w * normal[b]
            own, node, shift = shapes.vertices[i, b], shapes.nodes[n, b], shifts[n, b]
            for k in range(parts):
                row[7 + k] += back * (own[k] - node[k]) + ahead * shift[k]


@njit(cache=True, fastmath=True, forceinline=True)
def _add_row(row, weight, segment, sums):
    """Add the products of a row to the sums of its segment, and of size and build."""
    motion, size = sums.motion[segment], row.shape[0]
    for a in range(6):
        w = weight * row[a]
        for b in range(size):
            motion[a, b] += w * row[b]
    for a in range(6, size - 1):
        w = weight * row[a]
        for b in range(6, size):
            sums.build[a - 6, b - 6] += w * row[b]


@njit(cache=True)
def _free_space(v, target, settings, normal):
    """Compute how far a vertex stands in free space (m), and the direction back; 0 if it does not."""
    observed, nearest = target.full, target.nearest
    depth, labels, camera = observed.depth, observed.labels, observed.camera
    if v[2] < NEAR_M:
        return 0.0
    u, w = project(camera, v[0], v[1], v[2])
    a, b = int(np.rint(w)), int(np.rint(u))
    if a < 0 or b < 0 or a >= depth.shape[0] or b >= depth.shape[1]:
        return 0.0
    if labels[a, b] == 1:
        normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0
        return min(max(depth[a, b] - settings.free_space_slack - v[2], 0.0), settings.free_space_limit)
    if labels[a, b] != 0:
        return 0.0
    to_x, to_y = ray(camera, nearest[a, b, 1], nearest[a, b, 0])
    x, y = to_x * v[2] - v[0], to_y * v[2] - v[1]
    far = np.sqrt(x * x + y * y)
    if far < 1e-9:
        return 0.0
    normal[0], normal[1], normal[2] = x / far, y / far, 0.0
    return min(far, settings.free_space_limit)
