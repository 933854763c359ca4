"""Compiled loops of the articulated fit, E and M step; `depth_pose.fit.articulated` derives them."""

from __future__ import annotations

import numpy as np
from numba import njit

from depth_pose.body._skin_kernels import skin
from depth_pose.core._fast_exp import falling_exp
from depth_pose.core._raster_kernels import rasterize
from depth_pose.fit._tree_kernels import add_vertex, assemble, solve_tree, update
from depth_pose.fit._visibility_kernels import mark_visible, turn_normals

_REACH = 2.5
"""Vertices within this many standard deviations of a point count."""

_LANES = 16
"""Vertices around a cell are padded to a multiple of this many, with some that are `_FAR_AWAY`."""

_FAR_AWAY = np.float32(1e6)


@njit(cache=True, fastmath=True)
def sort_into_cells(positions, chosen, low_x, low_y, reach, rows, cols):
    """Sort the chosen of some positions into square cells, ``reach`` wide, over x and y.

    Returns their numbers in the order of the cells, and where each cell starts (rows * cols + 1).
    Those that lie off the grid are left out.
    """
    start = np.zeros(rows * cols + 1, np.int32)
    cell = np.full(positions.shape[0], -1, np.int32)
    for i in range(positions.shape[0]):
        if chosen[i]:
            row, col = (positions[i, 1] - low_y) / reach, (positions[i, 0] - low_x) / reach
            if row >= 0.0 and col >= 0.0 and row < rows and col < cols:
                cell[i] = int(row) * cols + int(col)
                start[cell[i] + 1] += 1
    for k in range(rows * cols):
        start[k + 1] += start[k]
    fill = start[:-1].copy()
    order = np.empty(start[-1], np.int32)
    for i in range(positions.shape[0]):
        if cell[i] >= 0:
            order[fill[cell[i]]] = i
            fill[cell[i]] += 1
    return order, start


@njit(cache=True, fastmath=True)
def assign(points, stride, vertices, visible, sigma, outlier, mass, pull):
    """E-step: responsibilities of visible vertices for every ``stride``-th point, summed per vertex.

    ``mass[m] = sum_n p(m | x_n)``, ``pull[m] = sum_n p(m | x_n) (x_n - v_m)``. Only vertices
    within `_REACH` sigma of a point count. Points and vertices are sorted into cells of that size;
    the vertices around a cell are gathered for all its points, so that the loops over them, which
    are all the time this takes, are vectorised.
    """
    mass[:] = 0.0
    pull[:] = 0.0
    reach = _REACH * sigma
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(vertices.shape[0]):
        if visible[i]:
            low_x, high_x = min(low_x, vertices[i, 0]), max(high_x, vertices[i, 0])
            low_y, high_y = min(low_y, vertices[i, 1]), max(high_y, vertices[i, 1])
    if high_x < low_x:
        return
    low_x, low_y = low_x - reach, low_y - reach
    rows, cols = int((high_y - low_y) / reach) + 2, int((high_x - low_x) / reach) + 2
    order, start = sort_into_cells(vertices, visible, low_x, low_y, reach, rows, cols)
    used = np.zeros(points.shape[0], np.bool_)
    used[::stride] = True
    point_order, point_start = sort_into_cells(points, used, low_x, low_y, reach, rows, cols)

    room = order.shape[0] + _LANES
    vx, vy, vz, p = (np.empty(room, np.float32), np.empty(room, np.float32), np.empty(room, np.float32),
                     np.empty(room, np.float32))  # fmt: skip
    m, rx, ry, rz = (np.empty(room, np.float32), np.empty(room, np.float32), np.empty(room, np.float32),
                     np.empty(room, np.float32))  # fmt: skip
    near = np.empty(room, np.int32)
    steep, most = np.float32(0.5 / (sigma * sigma)), np.float32(0.5 * _REACH * _REACH)
    for row in range(rows):
        for col in range(cols):
            first, last = point_start[row * cols + col], point_start[row * cols + col + 1]
            if first == last:
                continue
            count = 0
            for a in range(max(0, row - 1), min(rows, row + 2)):
                for k in range(start[a * cols + max(0, col - 1)], start[a * cols + min(cols, col + 2)]):
                    near[count] = order[k]
                    count += 1
            for k in range(count):
                vx[k], vy[k], vz[k] = vertices[near[k], 0], vertices[near[k], 1], vertices[near[k], 2]
            lanes = (count + _LANES - 1) // _LANES * _LANES
            for k in range(count, lanes):
                vx[k] = vy[k] = vz[k] = _FAR_AWAY
            for k in range(lanes):
                m[k] = rx[k] = ry[k] = rz[k] = np.float32(0.0)
            for j in point_order[first:last]:
                x, y, z = np.float32(points[j, 0]), np.float32(points[j, 1]), np.float32(points[j, 2])
                total = np.float32(outlier)
                for k in range(lanes):
                    dx, dy, dz = x - vx[k], y - vy[k], z - vz[k]
                    far = steep * (dx * dx + dy * dy + dz * dz)
                    w = falling_exp(min(far, most))
                    w = w if far < most else np.float32(0.0)
                    p[k] = w
                    total += w
                share = np.float32(1.0) / total
                for k in range(lanes):
                    w = share * p[k]
                    m[k] += w
                    rx[k] += w * (x - vx[k])
                    ry[k] += w * (y - vy[k])
                    rz[k] += w * (z - vz[k])
            for k in range(count):
                i = near[k]
                mass[i] += m[k]
                pull[i, 0] += rx[k]
                pull[i, 1] += ry[k]
                pull[i, 2] += rz[k]


@njit(cache=True, fastmath=True)
def add_points(vertices, normals, mass, pull, segment, origin, plane_weight, point_weight, inertia, force):
    """M-step data term: pull every vertex to its mean point, along its normal and in all."""
    metric = np.empty((3, 3))
    r = np.empty(3)
    for i in range(vertices.shape[0]):
        if mass[i] < 1e-3:
            continue
        for a in range(3):
            r[a] = pull[i, a] / mass[i]
            for b in range(3):
                metric[a, b] = mass[i] * plane_weight * normals[i, a] * normals[i, b]
            metric[a, a] += mass[i] * point_weight
        n = segment[i]
        add_vertex(vertices[i], origin, metric, r, inertia[n], force[n])


@njit(cache=True, fastmath=True)
def add_free_space(
    vertices, depth, labels, nearest, fx, fy, cx, cy, segment, origin, weight, slack, limit, inertia, force
):
    """Pull vertices that lie beside the silhouette into it, and those before the surface behind it."""
    rows, cols = depth.shape
    metric = np.zeros((3, 3))
    r = np.zeros(3)
    for i in range(0, vertices.shape[0], 2):  # every second one will do
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        if z < 0.05:
            continue
        a, b = int(np.rint(fy * y / z + cy)), int(np.rint(fx * x / z + cx))
        if a < 0 or b < 0 or a >= rows or b >= cols:
            continue
        if labels[a, b] == 1:
            gap = depth[a, b] - slack - z
            if gap <= 0.0:
                continue
            r[0], r[1], r[2] = 0.0, 0.0, min(gap, limit)
            metric[0, 0], metric[1, 1], metric[2, 2] = 0.0, 0.0, weight
        elif labels[a, b] == 0:
            r[0] = (nearest[a, b, 1] - cx) / fx * z - x
            r[1] = (nearest[a, b, 0] - cy) / fy * z - y
            r[2] = 0.0
            far = np.sqrt(r[0] * r[0] + r[1] * r[1])
            if far > limit:
                r[0], r[1] = r[0] * limit / far, r[1] * limit / far
            metric[0, 0], metric[1, 1], metric[2, 2] = weight, weight, 0.0
        else:
            continue
        n = segment[i]
        add_vertex(vertices[i], origin, metric, r, inertia[n], force[n])


@njit(cache=True)
def fit(
    points,
    strides,
    sigmas,
    depth,
    labels,
    nearest,
    intrinsics,
    zbuffer,
    coarse_intrinsics,
    rest,
    rest_normals,
    faces,
    influence,
    weight,
    rest_nodes,
    parents,
    free,
    above,
    stiffness,
    scale,
    settings,
    rotations,
    root,
):
    """Run all iterations; ``rotations`` and ``root`` go in as the start and come out as the fit."""
    outlier, plane_weight, point_weight, free_weight, slack, limit, prior, damping, max_step = settings
    fx, fy, cx, cy = intrinsics
    gx, gy, hx, hy = coarse_intrinsics
    count = rest.shape[0]
    vertices, normals, pull = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    nodes, mass, visible = np.empty((parents.shape[0], 3)), np.empty(count), np.empty(count, np.bool_)
    size = 3 + 3 * stiffness.shape[0]
    segment, inertia, force = influence[:, 0], np.empty((nodes.shape[0], 6, 6)), np.empty((nodes.shape[0], 6))
    matrix, gradient, moved = np.empty((size, size)), np.empty(size), np.zeros(size)
    for k in range(sigmas.shape[0]):
        skin(rest, rest_nodes, parents, influence, weight, rotations, root, scale, vertices, nodes)
        turn_normals(rest_normals, influence, rotations, normals)
        rasterize(vertices, faces, gx, gy, hx, hy, zbuffer)
        mark_visible(vertices, normals, zbuffer, gx, gy, hx, hy, 0.05, visible)
        if strides[k] > 1:  # half of the vertices will do for a part of the points
            visible[k % 2 :: 2] = False
        assign(points, strides[k], vertices, visible, sigmas[k], outlier, mass, pull)
        inertia[:] = 0.0
        force[:] = 0.0
        matrix[:] = 0.0
        add_points(vertices, normals, mass, pull, segment, root, plane_weight, point_weight, inertia, force)
        # all other terms are in proportion to the number of points
        amount = points.shape[0] / strides[k] / 800.0
        add_free_space(
            vertices,
            depth,
            labels,
            nearest,
            fx,
            fy,
            cx,
            cy,
            segment,
            root,
            2.0 * free_weight * amount,
            slack,
            limit,
            inertia,
            force,
        )
        assemble(inertia, force, nodes, root, parents, free, matrix, gradient)
        for i in range(size):
            matrix[i, i] += 1e-6 + damping * amount
            if i >= 3:
                hold = prior * amount * stiffness[(i - 3) // 3]
                matrix[i, i] += hold
                gradient[i] -= hold * moved[i]
        solve_tree(matrix, above, gradient)
        most = np.abs(gradient[3:]).max()
        if most > max_step:
            gradient *= max_step / most
        update(gradient, free, parents, rotations)
        root += gradient[:3]
        moved += gradient
