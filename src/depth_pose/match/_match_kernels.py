"""Compiled loops that place, render and score exemplars, for `depth_pose.match.placing`."""

from __future__ import annotations

import numpy as np

from depth_pose.body._skin_kernels import skin
from depth_pose.core._raster_kernels import score_mesh
from depth_pose.core._rotation_kernels import matrix_of, multiply
from depth_pose.core.kernels import njit

_multiply = njit(fastmath=True, forceinline=True)(multiply.py_func)


@njit(cache=True)
def place(entries, view_quats, view_origins, axes, origin, scale, rotations, translations):
    """Align the views of entries with the input's canonical axes; write ``T_camera_model`` of each."""
    views = view_quats.shape[1]
    view_matrix = np.empty((3, 3))
    for k in range(entries.shape[0]):
        exemplar, view = entries[k] // views, entries[k] % views
        matrix_of(view_quats[exemplar, view], view_matrix)
        _multiply(axes.T, view_matrix, rotations[k])
        for a in range(3):
            translations[k, a] = origin[a]
            for b in range(3):
                translations[k, a] -= scale * rotations[k, a, b] * view_origins[exemplar, view, b]


@njit(cache=True)
def score(placed, pose_quats, body, scale, observed, band):
    """Render placed exemplars and compare them.

    Writes ``scores``; ``shifts``, the translations that would align silhouettes and mean depths; and
    ``nodes``, in the camera frame.
    """
    count = body.nodes.shape[0]
    local, turned = np.empty((3, 3)), np.empty((count, 3, 3))
    vertices, sums = np.empty(body.vertices.shape), np.empty(5)
    zbuffer = np.empty(observed.depth.shape, np.float32)
    for k in range(placed.exemplars.shape[0]):
        for n in range(count):
            matrix_of(pose_quats[placed.exemplars[k], n], local)
            multiply(placed.rotations[k], local, turned[n])
        skin(body, turned, placed.translations[k], scale, vertices, placed.nodes[k])
        score_mesh(vertices, body.faces, observed, band, zbuffer, sums)
        placed.scores[k], placed.shifts[k] = sums[0], sums[2:]


@njit(cache=True)
def keep_different(nodes, apart, most):
    """Return the first ``most`` poses, nodes (K, 21, 3), that are farther than ``apart`` from those before.

    The distance of two poses is the mean distance of their nodes, metres.
    """
    kept, count = np.empty(most, np.int64), 0
    for k in range(nodes.shape[0]):
        is_new = True
        for other in kept[:count]:
            total = 0.0
            for n in range(nodes.shape[1]):
                x, y = nodes[k, n, 0] - nodes[other, n, 0], nodes[k, n, 1] - nodes[other, n, 1]
                z = nodes[k, n, 2] - nodes[other, n, 2]
                total += np.sqrt(x * x + y * y + z * z)
            is_new &= total > apart * nodes.shape[1]
        if is_new:
            kept[count] = k
            count += 1
        if count == most:
            break
    return kept[:count]
