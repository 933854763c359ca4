"""Compiled loops of the articulated fit; `depth_pose.registration.articulated` derives them."""

from __future__ import annotations

import numpy as np
from numba import njit

from depth_pose._fast_exp import falling_exp
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
def add_vertex(v, origin, m, r, inertia, force):
    """Add one vertex to its segment's normal equations for a free motion ``w x (v - origin) + t``.

    ``m`` is a symmetric 3x3 metric, ``r`` the residual; ``inertia`` (6, 6) and ``force`` (6,) take
    ``J' m J`` and ``J' m r`` with the Jacobian ``J = [-[v - origin]_x, 1]``.
    """
    x, y, z = v[0] - origin[0], v[1] - origin[1], v[2] - origin[2]
    for a in range(3):
        # row a of m J: its first three columns are (row a of m) . [-[v]_x]
        m0, m1, m2 = m[a, 0], m[a, 1], m[a, 2]
        inertia[3 + a, 0] += m2 * y - m1 * z
        inertia[3 + a, 1] += m0 * z - m2 * x
        inertia[3 + a, 2] += m1 * x - m0 * y
        inertia[3 + a, 3] += m0
        inertia[3 + a, 4] += m1
        inertia[3 + a, 5] += m2
        force[3 + a] += m0 * r[0] + m1 * r[1] + m2 * r[2]
    for b in range(3):
        q0 = m[0, 2] * y - m[0, 1] * z if b == 0 else m[0, 0] * z - m[0, 2] * x
        q1 = m[1, 2] * y - m[1, 1] * z if b == 0 else m[1, 0] * z - m[1, 2] * x
        q2 = m[2, 2] * y - m[2, 1] * z if b == 0 else m[2, 0] * z - m[2, 2] * x
        if b == 2:
            q0, q1, q2 = m[0, 1] * x - m[0, 0] * y, m[1, 1] * x - m[1, 0] * y, m[2, 1] * x - m[2, 0] * y
        inertia[0, b] += q2 * y - q1 * z
        inertia[1, b] += q0 * z - q2 * x
        inertia[2, b] += q1 * x - q0 * y
        force[b] += q0 * r[0] + q1 * r[1] + q2 * r[2]


@njit(cache=True, fastmath=True)
def assemble(inertia, force, nodes, origin, parents, free, matrix, gradient):
    """Put the normal equations of the joint angles together from those of the free segments.

    What moves node k moves all segments below it alike, so their inertias are summed up the tree;
    the block of two nodes is that of the lower one's sum, if one lies above the other, else zero.
    ``inertia`` and ``force`` are used up.
    """
    count = parents.shape[0]
    for n in range(count):  # the kernel above fills the lower left block only
        for a in range(3):
            for b in range(3):
                inertia[n, b, 3 + a] = inertia[n, 3 + a, b]
    for n in range(count - 1, 0, -1):
        inertia[parents[n]] += inertia[n]
        force[parents[n]] += force[n]
    matrix[:3, :3] = inertia[0, 3:, 3:]
    gradient[:3] = force[0, 3:]
    turned = np.empty((6, 3))
    for k in range(count):
        if free[k] < 0:
            continue
        c = 3 + 3 * free[k]
        x, y, z = nodes[k, 0] - origin[0], nodes[k, 1] - origin[1], nodes[k, 2] - origin[2]
        for i in range(6):  # inertia times [1; [p]_x], the motion of a turn about the node
            t0, t1, t2 = inertia[k, i, 3], inertia[k, i, 4], inertia[k, i, 5]
            turned[i, 0] = inertia[k, i, 0] + t1 * z - t2 * y
            turned[i, 1] = inertia[k, i, 1] + t2 * x - t0 * z
            turned[i, 2] = inertia[k, i, 2] + t0 * y - t1 * x
        t0, t1, t2 = force[k, 3], force[k, 4], force[k, 5]
        gradient[c] = force[k, 0] + t1 * z - t2 * y
        gradient[c + 1] = force[k, 1] + t2 * x - t0 * z
        gradient[c + 2] = force[k, 2] + t0 * y - t1 * x
        for a in range(3):
            for i in range(3):
                matrix[c + a, i] = matrix[i, c + a] = turned[3 + i, a]
        j = k
        while j >= 0:
            if free[j] >= 0:
                d = 3 + 3 * free[j]
                u, v, w = nodes[j, 0] - origin[0], nodes[j, 1] - origin[1], nodes[j, 2] - origin[2]
                for a in range(3):
                    t0, t1, t2 = turned[3, a], turned[4, a], turned[5, a]
                    matrix[d, c + a] = matrix[c + a, d] = turned[0, a] + t1 * w - t2 * v
                    matrix[d + 1, c + a] = matrix[c + a, d + 1] = turned[1, a] + t2 * u - t0 * w
                    matrix[d + 2, c + a] = matrix[c + a, d + 2] = turned[2, a] + t0 * v - t1 * u
            j = parents[j]


@njit(cache=True)
def multiply(a, b, out):
    """Product of two 3 x 3 matrices; ``out`` is neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True)
def update(step, free, parents, rotations):
    """Turn every node's segment by the steps of its free ancestors, the root's first."""
    count = rotations.shape[0]
    turn = np.zeros((count, 3, 3))
    own, product = np.empty((3, 3)), np.empty((3, 3))
    for n in range(count):
        if parents[n] >= 0:
            turn[n] = turn[parents[n]]
        else:
            turn[n, 0, 0] = turn[n, 1, 1] = turn[n, 2, 2] = 1.0
        if free[n] >= 0:
            rotation_of(step[3 + 3 * free[n] : 6 + 3 * free[n]], own)
            multiply(turn[n], own, product)
            turn[n] = product
        multiply(turn[n], rotations[n], product)
        rotations[n] = product


@njit(cache=True)
def solve_tree(matrix, above, right):
    """Solve ``matrix x = right`` in place, where parameters act together only along a tree.

    Factorises ``L' D L`` from the leaves up, which fills nothing in (R. Featherstone, *Efficient
    factorization of the joint-space inertia matrix for branched kinematic trees*, 2005). ``above``
    (n,) is each parameter's next one toward the root, with a lower number; -1 for none. Only the
    lower triangle is read, and it is overwritten.
    """
    n = above.shape[0]
    for k in range(n - 1, -1, -1):
        i = above[k]
        while i >= 0:
            ratio = matrix[k, i] / matrix[k, k]
            j = i
            while j >= 0:
                matrix[i, j] -= ratio * matrix[k, j]
                j = above[j]
            matrix[k, i] = ratio
            i = above[i]
    for k in range(n - 1, -1, -1):
        i = above[k]
        while i >= 0:
            right[i] -= matrix[k, i] * right[k]
            i = above[i]
    for k in range(n):
        right[k] /= matrix[k, k]
        i = above[k]
        while i >= 0:
            right[k] -= matrix[k, i] * right[i]
            i = above[i]


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
