"""Compiled loops of the articulated fit; `depth_pose.registration.articulated` derives them."""

from __future__ import annotations

import numpy as np
from numba import njit

from depth_pose._raster_kernels import rasterize
from depth_pose.body._skin_kernels import skin


@njit(cache=True)
def rotation_of(w, out):
    """Rodrigues' formula."""
    angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    angle = np.sqrt(angle2)
    if angle < 1e-8:
        a, b = 1.0, 0.5
    else:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    x, y, z = w[0], w[1], w[2]
    out[0, 0], out[1, 1], out[2, 2] = (
        1 - b * (y * y + z * z),
        1 - b * (x * x + z * z),
        1 - b * (x * x + y * y),
    )
    out[0, 1], out[1, 0] = b * x * y - a * z, b * x * y + a * z
    out[0, 2], out[2, 0] = b * x * z + a * y, b * x * z - a * y
    out[1, 2], out[2, 1] = b * y * z - a * x, b * y * z + a * x


@njit(cache=True, fastmath=True)
def turn_normals(rest_normals, influence, rotations, normals):
    """Turn each vertex's rest normal with the node that moves it most."""
    for i in range(rest_normals.shape[0]):
        r = rotations[influence[i, 0]]
        for a in range(3):
            normals[i, a] = (
                r[a, 0] * rest_normals[i, 0] + r[a, 1] * rest_normals[i, 1] + r[a, 2] * rest_normals[i, 2]
            )


@njit(cache=True, fastmath=True)
def mark_visible(vertices, normals, zbuffer, fx, fy, cx, cy, tolerance, visible):
    """Which vertices face the camera and lie at most ``tolerance`` behind the rendered depth."""
    rows, cols = zbuffer.shape
    for i in range(vertices.shape[0]):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        visible[i] = False
        if z < 0.05 or normals[i, 0] * x + normals[i, 1] * y + normals[i, 2] * z > 0.0:
            continue
        a, b = int(np.rint(fy * y / z + cy)), int(np.rint(fx * x / z + cx))
        if a < 0 or b < 0 or a >= rows or b >= cols:
            continue
        visible[i] = z <= zbuffer[a, b] + tolerance


@njit(cache=True, fastmath=True)
def assign(points, stride, vertices, visible, sigma, outlier, mass, target):
    """E-step: responsibilities of visible vertices for every ``stride``-th point, summed per vertex.

    ``mass[m] = sum_n p(m | x_n)``, ``target[m] = sum_n p(m | x_n) x_n / mass[m]``. Only vertices
    within 2.5 sigma of a point count; they are found through a grid of that cell size.
    """
    reach = 2.5 * sigma
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(vertices.shape[0]):
        if visible[i]:
            low_x, high_x = min(low_x, vertices[i, 0]), max(high_x, vertices[i, 0])
            low_y, high_y = min(low_y, vertices[i, 1]), max(high_y, vertices[i, 1])
    mass[:] = 0.0
    target[:] = 0.0
    if high_x < low_x:
        return
    cols, rows = int((high_x - low_x) / reach) + 1, int((high_y - low_y) / reach) + 1
    start = np.zeros(rows * cols + 1, np.int32)
    cell = np.full(vertices.shape[0], -1, np.int32)
    for i in range(vertices.shape[0]):
        if visible[i]:
            cell[i] = int((vertices[i, 1] - low_y) / reach) * cols + int((vertices[i, 0] - low_x) / reach)
            start[cell[i] + 1] += 1
    for k in range(rows * cols):
        start[k + 1] += start[k]
    fill = start[:-1].copy()
    order = np.empty(start[-1], np.int32)
    for i in range(vertices.shape[0]):
        if cell[i] >= 0:
            order[fill[cell[i]]] = i
            fill[cell[i]] += 1
    p = np.empty(order.shape[0])
    index = np.empty(order.shape[0], np.int32)
    steep = -0.5 / (sigma * sigma)
    for j in range(0, points.shape[0], stride):
        x, y, z = points[j, 0], points[j, 1], points[j, 2]
        a0, b0 = int(np.floor((y - low_y) / reach)), int(np.floor((x - low_x) / reach))
        total = outlier
        count = 0
        for a in range(max(0, a0 - 1), min(rows, a0 + 2)):
            for b in range(max(0, b0 - 1), min(cols, b0 + 2)):
                for k in range(start[a * cols + b], start[a * cols + b + 1]):
                    i = order[k]
                    dx, dy, dz = vertices[i, 0] - x, vertices[i, 1] - y, vertices[i, 2] - z
                    d2 = dx * dx + dy * dy + dz * dz
                    if d2 < reach * reach:
                        w = np.exp(steep * d2)
                        p[count] = w
                        index[count] = i
                        count += 1
                        total += w
        for k in range(count):
            w = p[k] / total
            i = index[k]
            mass[i] += w
            target[i, 0] += w * x
            target[i, 1] += w * y
            target[i, 2] += w * z
    for i in range(vertices.shape[0]):
        if mass[i] > 0.0:
            for a in range(3):
                target[i, a] /= mass[i]


@njit(cache=True, fastmath=True)
def add_vertex(chain, share, length, v, nodes, m, r, normal_matrix, gradient):
    """Add one vertex to the normal equations.

    ``chain`` are its ``length`` free nodes (numbers of parameters' triples and nodes), ``share``
    the weight with which each moves it, ``m`` a symmetric 3x3 metric, ``r`` the residual.
    """
    # columns of the Jacobian: translation, then for each free node -[v - p]_x times its share
    size = 3 * (length + 1)
    jacobian = np.zeros((3, size))
    where = np.empty(size, np.int32)
    for a in range(3):
        jacobian[a, a] = 1.0
        where[a] = a
    for k in range(length):
        n, s = chain[k, 1], share[k]
        x, y, z = s * (v[0] - nodes[n, 0]), s * (v[1] - nodes[n, 1]), s * (v[2] - nodes[n, 2])
        c = 3 * (k + 1)
        jacobian[1, c], jacobian[2, c] = -z, y
        jacobian[0, c + 1], jacobian[2, c + 1] = z, -x
        jacobian[0, c + 2], jacobian[1, c + 2] = -y, x
        for a in range(3):
            where[c + a] = 3 + 3 * chain[k, 0] + a
    for i in range(size):
        q0 = m[0, 0] * jacobian[0, i] + m[0, 1] * jacobian[1, i] + m[0, 2] * jacobian[2, i]
        q1 = m[1, 0] * jacobian[0, i] + m[1, 1] * jacobian[1, i] + m[1, 2] * jacobian[2, i]
        q2 = m[2, 0] * jacobian[0, i] + m[2, 1] * jacobian[1, i] + m[2, 2] * jacobian[2, i]
        gradient[where[i]] += q0 * r[0] + q1 * r[1] + q2 * r[2]
        for j in range(i + 1):
            normal_matrix[where[i], where[j]] += (
                q0 * jacobian[0, j] + q1 * jacobian[1, j] + q2 * jacobian[2, j]
            )


@njit(cache=True)
def update(step, free, parents, rotations):
    """Turn every node's segment by the steps of its free ancestors, the root's first."""
    count = rotations.shape[0]
    turn = np.zeros((count, 3, 3))
    own = np.empty((3, 3))
    for n in range(count):
        if parents[n] >= 0:
            turn[n] = turn[parents[n]]
        else:
            turn[n] = np.eye(3)
        if free[n] >= 0:
            rotation_of(step[3 + 3 * free[n] : 6 + 3 * free[n]], own)
            turn[n] = turn[n] @ own
        rotations[n] = turn[n] @ rotations[n]


@njit(cache=True)
def nearest_person(labels, nearest):
    """Row and column of (nearly) the nearest person pixel to every pixel, by two sweeps."""
    rows, cols = labels.shape
    for i in range(rows):
        for j in range(cols):
            if labels[i, j] == 1:
                nearest[i, j, 0], nearest[i, j, 1] = i, j
            else:
                nearest[i, j, 0], nearest[i, j, 1] = -10000, -10000
    for sweep in range(2):
        for ii in range(rows):
            i = ii if sweep == 0 else rows - 1 - ii
            back = -1 if sweep == 0 else 1
            for jj in range(cols):
                j = jj if sweep == 0 else cols - 1 - jj
                _relax(nearest, i, j, i + back, j)
                _relax(nearest, i, j, i, j + back)
                _relax(nearest, i, j, i + back, j + back)
                _relax(nearest, i, j, i + back, j - back)


@njit(cache=True)
def _relax(nearest, i, j, a, b):
    if a < 0 or b < 0 or a >= nearest.shape[0] or b >= nearest.shape[1]:
        return
    p, q = nearest[a, b, 0], nearest[a, b, 1]
    r, s = nearest[i, j, 0], nearest[i, j, 1]
    if (p - i) ** 2 + (q - j) ** 2 < (r - i) ** 2 + (s - j) ** 2:
        nearest[i, j, 0], nearest[i, j, 1] = p, q


@njit(cache=True, fastmath=True)
def add_points(
    vertices, normals, mass, target, chain, share, length, nodes, plane_weight, point_weight, matrix, gradient
):
    """M-step data term: pull every vertex to its mean point, along its normal and in all."""
    metric = np.empty((3, 3))
    r = np.empty(3)
    for i in range(vertices.shape[0]):
        if mass[i] < 1e-3:
            continue
        for a in range(3):
            r[a] = target[i, a] - vertices[i, a]
            for b in range(3):
                metric[a, b] = mass[i] * plane_weight * normals[i, a] * normals[i, b]
            metric[a, a] += mass[i] * point_weight
        add_vertex(chain[i], share[i], length[i], vertices[i], nodes, metric, r, matrix, gradient)


@njit(cache=True, fastmath=True)
def add_free_space(
    vertices,
    depth,
    labels,
    nearest,
    fx,
    fy,
    cx,
    cy,
    chain,
    share,
    length,
    nodes,
    weight,
    slack,
    limit,
    matrix,
    gradient,
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
        add_vertex(chain[i], share[i], length[i], vertices[i], nodes, metric, r, matrix, gradient)


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
    chain,
    share,
    length,
    free,
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
    vertices, normals, target = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    nodes, mass, visible = np.empty((parents.shape[0], 3)), np.empty(count), np.empty(count, np.bool_)
    size = 3 + 3 * stiffness.shape[0]
    matrix, gradient, moved = np.empty((size, size)), np.empty(size), np.zeros(size)
    for k in range(sigmas.shape[0]):
        skin(rest, rest_nodes, parents, influence, weight, rotations, root, scale, vertices, nodes)
        turn_normals(rest_normals, influence, rotations, normals)
        rasterize(vertices, faces, gx, gy, hx, hy, zbuffer)
        mark_visible(vertices, normals, zbuffer, gx, gy, hx, hy, 0.05, visible)
        if strides[k] > 1:  # half of the vertices will do for a part of the points
            visible[k % 2 :: 2] = False
        assign(points, strides[k], vertices, visible, sigmas[k], outlier, mass, target)
        matrix[:] = 0.0
        gradient[:] = 0.0
        add_points(
            vertices,
            normals,
            mass,
            target,
            chain,
            share,
            length,
            nodes,
            plane_weight,
            point_weight,
            matrix,
            gradient,
        )
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
            chain,
            share,
            length,
            nodes,
            2.0 * free_weight * amount,
            slack,
            limit,
            matrix,
            gradient,
        )
        for i in range(size):
            for j in range(i):
                matrix[j, i] = matrix[i, j]
            matrix[i, i] += 1e-6 + damping * amount
            if i >= 3:
                hold = prior * amount * stiffness[(i - 3) // 3]
                matrix[i, i] += hold
                gradient[i] -= hold * moved[i]
        step = np.linalg.solve(matrix, gradient)
        most = np.abs(step[3:]).max()
        if most > max_step:
            step *= max_step / most
        update(step, free, parents, rotations)
        root += step[:3]
        moved += step
