"""Compiled loop of the fit to a volume; `depth_pose.volume.fit` says what it is for."""

from __future__ import annotations

import numpy as np
from numba import njit

from depth_pose.body._skin_kernels import skin
from depth_pose.fit._articulated_kernels import add_points, assign
from depth_pose.fit._tree_kernels import assemble, solve_tree, update
from depth_pose.fit._visibility_kernels import turn_normals


@njit(cache=True)
def fit_volume(
    points,
    sigmas,
    rest,
    rest_normals,
    influence,
    weight,
    rest_nodes,
    parents,
    free,
    above,
    stiffness,
    scale,
    trust,
    eyes,
    settings,
    rotations,
    root,
):
    """Run all iterations; ``rotations`` and ``root`` go in as the start and come out as the fit.

    Where there are ``eyes`` (n, 3), only what faces one of them is on the surface. Gives the root mean
    square distance of the trusted vertices from the points assigned to them, along the normals, and the
    factor on the body's size that would make it least.
    """
    outlier, plane_weight, point_weight, prior, root_prior, damping, max_step = settings
    count = rest.shape[0]
    vertices, normals, pull = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    nodes, mass, used = np.empty((parents.shape[0], 3)), np.empty(count), np.empty(count, np.bool_)
    size = 3 + 3 * stiffness.shape[0]
    segment, inertia, force = influence[:, 0], np.empty((nodes.shape[0], 6, 6)), np.empty((nodes.shape[0], 6))
    matrix, gradient, moved = np.empty((size, size)), np.empty(size), np.zeros(size)
    amount = points.shape[0] / 800.0
    residual, factor = 0.0, 1.0
    for k in range(sigmas.shape[0]):
        skin(rest, rest_nodes, parents, influence, weight, rotations, root, scale, vertices, nodes)
        turn_normals(rest_normals, influence, rotations, normals)
        used[:] = True
        used[k % 2 :: 2] = False
        if eyes.shape[0]:
            for i in range(count):
                faces = False
                for e in range(eyes.shape[0]):
                    side = 0.0
                    for a in range(3):
                        side += normals[i, a] * (vertices[i, a] - eyes[e, a])
                    faces = faces or side <= 0.0
                used[i] = used[i] and faces
        assign(points, 1, vertices, used, sigmas[k], outlier, mass, pull)
        total, square, reach, grow = 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            mass[i] *= trust[i]
            if mass[i] > 0.0:
                along, arm = 0.0, 0.0
                for a in range(3):
                    pull[i, a] *= trust[i]
                    along += pull[i, a] * normals[i, a]
                    arm += (vertices[i, a] - root[a]) * normals[i, a]
                total += mass[i]
                square += along * along / mass[i]
                reach += mass[i] * arm * arm
                grow += arm * along
        residual = np.sqrt(square / max(total, 1e-9))
        factor = 1.0 + grow / max(reach, 1e-9)
        inertia[:] = 0.0
        force[:] = 0.0
        matrix[:] = 0.0
        add_points(vertices, normals, mass, pull, segment, root, plane_weight, point_weight, inertia, force)
        assemble(inertia, force, nodes, root, parents, free, matrix, gradient)
        for i in range(size):
            hold = amount * (prior * stiffness[(i - 3) // 3] if i >= 3 else root_prior)
            matrix[i, i] += 1e-6 + damping * amount + hold
            gradient[i] -= hold * moved[i]
        solve_tree(matrix, above, gradient)
        most = np.abs(gradient[3:]).max()
        if most > max_step:
            gradient *= max_step / most
        update(gradient, free, parents, rotations)
        root += gradient[:3]
        moved += gradient
    return residual, factor
