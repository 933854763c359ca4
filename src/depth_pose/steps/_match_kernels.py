"""Compiled loops that place, render and score exemplars; `depth_pose.steps.placing` uses them."""

from __future__ import annotations

import numpy as np
from numba import njit

from depth_pose.body._skin_kernels import skin
from depth_pose.core._raster_kernels import compare, rasterize


@njit(cache=True)
def matrix_of(quat, out):
    """Rotation matrix of a quaternion x, y, z, w, normalised first."""
    x, y, z, w = float(quat[0]), float(quat[1]), float(quat[2]), float(quat[3])
    s = 2.0 / (x * x + y * y + z * z + w * w)
    out[0, 0], out[0, 1], out[0, 2] = 1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)
    out[1, 0], out[1, 1], out[1, 2] = s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)
    out[2, 0], out[2, 1], out[2, 2] = s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)


@njit(cache=True, fastmath=True)
def multiply(a, b, out):
    """Product of two 3x3 matrices."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True)
def place(entries, view_quats, view_origins, axes, origin, scale, rotations, translations):
    """Lay entries' views over the input's canonical axes: writes ``T_camera_model`` of each."""
    views = view_quats.shape[1]
    view_matrix = np.empty((3, 3))
    for k in range(entries.shape[0]):
        exemplar, view = entries[k] // views, entries[k] % views
        matrix_of(view_quats[exemplar, view], view_matrix)
        multiply(axes.T, view_matrix, rotations[k])
        for a in range(3):
            translations[k, a] = origin[a]
            for b in range(3):
                translations[k, a] -= scale * rotations[k, a, b] * view_origins[exemplar, view, b]


@njit(cache=True)
def score(
    exemplars,
    pose_quats,
    scale,
    rest,
    rest_nodes,
    parents,
    influence,
    weight,
    faces,
    depth,
    labels,
    fx,
    fy,
    cx,
    cy,
    band,
    rotations,
    translations,
    scores,
    shifts,
    nodes,
):
    """Render placed exemplars and compare them.

    Writes ``scores``; ``shifts``, the translations that would bring silhouettes and mean depths
    together; and ``nodes``, in the camera frame.
    """
    local, turned = np.empty((3, 3)), np.empty((parents.shape[0], 3, 3))
    vertices, zbuffer, sums = np.empty(rest.shape), np.empty(depth.shape), np.empty(5)
    for k in range(exemplars.shape[0]):
        for n in range(parents.shape[0]):
            matrix_of(pose_quats[exemplars[k], n], local)
            multiply(rotations[k], local, turned[n])
        skin(rest, rest_nodes, parents, influence, weight, turned, translations[k], scale, vertices, nodes[k])
        rasterize(vertices, faces, fx, fy, cx, cy, zbuffer)
        compare(zbuffer, depth, labels, band, sums)
        z = 0.0
        for i in range(vertices.shape[0]):
            z += vertices[i, 2]
        z /= vertices.shape[0]
        scores[k] = sums[0]
        shifts[k, 0], shifts[k, 1], shifts[k, 2] = sums[3] * z / fx, sums[4] * z / fy, sums[2]
