"""Compiled loops of the articulated fit, E and M step; `depth_pose.refine.articulated` derives them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from depth_pose.body._skin_kernels import skin
from depth_pose.core._camera_kernels import project, ray
from depth_pose.core._fast_exp import falling_exp
from depth_pose.core._grid_kernels import Grid, bounds, sort_into_cells
from depth_pose.core._raster_kernels import NEAR_M, rasterize
from depth_pose.core.kernels import njit
from depth_pose.refine._aim_kernels import SHARED_M, nearer_naming
from depth_pose.refine._tree_kernels import Equations, add_vertex, take_step
from depth_pose.refine._visibility_kernels import mark_visible, turn_normals

_REACH = 2.5
"""Range of a Gaussian, in standard deviations; vertices farther from a point are ignored."""

_LANES = 16
"""The vertices around a cell are padded with `_FAR_AWAY` to a multiple of this number."""

_FAR_AWAY = np.float32(1e6)
"""Coordinate of padding vertices (m), too far away to get any weight."""

_LEAST_MASS = 1e-3
"""Vertices with less responsibility than this are ignored in the M-step."""

_THIN = 3
"""Stride of the points in coarse iterations; set by hand."""

USUAL_POINTS = 800.0
"""Number of points for which the weights are given (`FitTuning.max_points`); weights scale with the
number."""

_BEHIND_M = 0.05
"""A vertex is visible if it lies at most this far (m) behind the rendered depth; set by hand."""


_LOOK_EVERY = 2
"""Iterations between two visibility updates; 2 is as accurate as 1 and a fifth faster."""

_ELSEWHERE_M = 0.15
"""Joint distance (m) at which the robust weight is a quarter; it falls further beyond; set by hand."""

_USUAL_NOISE_M, _MOST_NOISE = 0.02, 3.0
"""Shared noise of the points (m) up to which proposals have their usual weight: the finest standard deviation
of the schedule; and the multiple of it from which the weight rises no further: the coarsest."""

_FOOT_SHARE = 0.5
"""Weight of the proposals of an ankle and of its heel, whose errors are alike: together they count once."""

_FLOOR_M, _OFF_FLOOR_M = 0.015, 0.04
"""Standard deviation of a standing sole's height (m), and the height at which the robust weight is a
quarter; set by hand."""


class Settings(NamedTuple):
    """Values of `depth_pose.refine.tuning.FitTuning`, by the same names; ``root_prior`` is 0."""

    coarse_sigma: float
    outlier: float
    plane_weight: float
    point_weight: float
    free_space_weight: float
    free_space_slack: float
    free_space_limit: float
    proposal_weight: float
    floor_weight: float
    prior: float
    root_prior: float
    damping: float
    max_step: float


class Surface(NamedTuple):
    """A posed skin: vertices and normals (V, 3), and each vertex's most influential node, (V,)."""

    vertices: Any
    normals: Any
    segment: Any


@njit(cache=True, fastmath=True, forceinline=True)
def assign(points, stride, vertices, visible, sigma, outlier, mass, pull):
    """Run the E-step: sum the responsibilities of visible vertices over every ``stride``-th point.

    ``mass[m] = sum_n p(m | x_n)``, ``pull[m] = sum_n p(m | x_n) (x_n - v_m)``. Only vertices within `_REACH`
    sigma of a point count. Points and vertices are sorted into cells of that size. The vertices around a cell
    are gathered once for all its points, so that the inner loop over them, which dominates the run time, is
    vectorised.
    """
    mass[:] = 0.0
    pull[:] = 0.0
    reach = _REACH * sigma
    low_x, low_y, high_x, high_y = bounds(vertices, visible)
    if high_x < low_x:
        return
    low_x, low_y = low_x - reach, low_y - reach
    rows, cols = int((high_y - low_y) / reach) + 2, int((high_x - low_x) / reach) + 2
    grid = Grid(low_x, low_y, reach, rows, cols)
    order, start = sort_into_cells(vertices, visible, grid)
    used = np.zeros(points.shape[0], np.bool_)
    used[::stride] = True
    point_order, point_start = sort_into_cells(points, used, grid)

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


@njit(cache=True, fastmath=True, forceinline=True)
def _cost_of(metric, r):
    """Compute ``r' M r`` of a residual."""
    cost = 0.0
    for a in range(3):
        for b in range(3):
            cost += r[a] * metric[a, b] * r[b]
    return cost


@njit(cache=True, fastmath=True, forceinline=True)
def add_points(surface, mass, pull, origin, settings, equations):
    """Add the data term of the M-step: pull each vertex to its mean point, along its normal and overall.

    Returns the cost, as all terms do: the sum of ``r' M r``.
    """
    vertices, normals = surface.vertices, surface.normals
    metric = np.empty((3, 3))
    r = np.empty(3)
    cost = 0.0
    for i in range(vertices.shape[0]):
        if mass[i] < _LEAST_MASS:
            continue
        for a in range(3):
            r[a] = pull[i, a] / mass[i]
            for b in range(3):
                metric[a, b] = mass[i] * settings.plane_weight * normals[i, a] * normals[i, b]
            metric[a, a] += mass[i] * settings.point_weight
        cost += _cost_of(metric, r)
        add_vertex(vertices[i], origin, metric, r, equations, surface.segment[i])
    return cost


@njit(cache=True, fastmath=True, forceinline=True)
def add_free_space(surface, observed, nearest, origin, weight, settings, equations):
    """Pull vertices beside the silhouette into it, and vertices in front of the surface behind it."""
    vertices, depth, labels, camera = surface.vertices, observed.depth, observed.labels, observed.camera
    slack, limit = settings.free_space_slack, settings.free_space_limit
    rows, cols = depth.shape
    metric = np.zeros((3, 3))
    r = np.zeros(3)
    cost = 0.0
    for i in range(0, vertices.shape[0], 2):  # every second vertex is enough
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        if z < NEAR_M:
            continue
        u, v = project(camera, x, y, z)
        a, b = int(np.rint(v)), int(np.rint(u))
        if a < 0 or b < 0 or a >= rows or b >= cols:
            continue
        if labels[a, b] == 1:
            gap = depth[a, b] - slack - z
            if gap <= 0.0:
                continue
            r[0], r[1], r[2] = 0.0, 0.0, min(gap, limit)
            metric[0, 0], metric[1, 1], metric[2, 2] = 0.0, 0.0, weight
        elif labels[a, b] == 0:
            to_x, to_y = ray(camera, nearest[a, b, 1], nearest[a, b, 0])
            r[0], r[1], r[2] = to_x * z - x, to_y * z - y, 0.0
            far = np.sqrt(r[0] * r[0] + r[1] * r[1])
            if far > limit:
                r[0], r[1] = r[0] * limit / far, r[1] * limit / far
            metric[0, 0], metric[1, 1], metric[2, 2] = weight, weight, 0.0
        else:
            continue
        cost += _cost_of(metric, r)
        add_vertex(vertices[i], origin, metric, r, equations, surface.segment[i])
    return cost


@njit(cache=True, fastmath=True, forceinline=True)
def add_proposals(proposals, feet, surface, nodes, origin, weight, equations):
    """Pull joints and heels to their proposed places, with the left/right naming nearer to the pose."""
    side = nearer_naming(nodes[proposals.nodes], proposals.places, proposals.weights)
    heels, cost = proposals.heels[side], 0.0
    for j in range(proposals.nodes.shape[0]):
        n, place, sigmas = proposals.nodes[j], proposals.places[side, j], proposals.sigmas[side, j]
        is_shared = heels.shape[0] > 0 and (n == feet.ankles[0] or n == feet.ankles[1])
        w = _FOOT_SHARE * weight if is_shared else weight
        cost += _observe(nodes[n], place, sigmas[0], sigmas[1], origin, w, equations, n)
    for h in range(heels.shape[0]):
        i, w = feet.heels[h], _FOOT_SHARE * weight
        place, across, along = heels[h, :3], heels[h, 3], heels[h, 4]
        cost += _observe(surface.vertices[i], place, across, along, origin, w, equations, surface.segment[i])
    return cost


@njit(cache=True, fastmath=True, forceinline=True)
def _observe(point, place, across_m, along_m, origin, weight, equations, segment):
    """Add an observation of a point, with one variance across the ray to its place and another along it.

    The robust weights are those of Geman and McClure (1987), with distances in units of `_ELSEWHERE_M`.
    """
    metric, r, ray = np.empty((3, 3)), np.empty(3), np.empty(3)
    far, long = 0.0, 0.0
    for a in range(3):
        r[a] = place[a] - point[a]
        far += r[a] * r[a]
        long += place[a] ** 2
    share = weight / (1.0 + far / (_ELSEWHERE_M * _ELSEWHERE_M)) ** 2
    across = share / (across_m**2 + SHARED_M**2)
    along = share / (along_m**2 + SHARED_M**2)
    for a in range(3):
        ray[a] = place[a] / np.sqrt(long)
    for a in range(3):
        for b in range(3):
            metric[a, b] = (along - across) * ray[a] * ray[b]
        metric[a, a] += across
    add_vertex(point, origin, metric, r, equations, segment)
    return _cost_of(metric, r)


@njit(cache=True, fastmath=True, forceinline=True)
def add_floor(surface, feet, floor, origin, weight, equations):
    """Pull balls of feet to the floor where they are near it, and heels out of it; robust as proposals."""
    cost = 0.0
    if floor[3] <= 0.0:
        return cost
    metric, r = np.empty((3, 3)), np.empty(3)
    for k in range(feet.soles.shape[0]):
        i = feet.soles[k]
        v, height = surface.vertices[i], floor[3]
        for a in range(3):
            height += floor[a] * v[a]
        if height > 0.0 and feet.is_heel[k]:
            continue
        share = weight * feet.share[k] / (_FLOOR_M * (1.0 + (height / _OFF_FLOOR_M) ** 2)) ** 2
        for a in range(3):
            r[a] = -height * floor[a]
            for b in range(3):
                metric[a, b] = share * floor[a] * floor[b]
        cost += share * height * height
        add_vertex(v, origin, metric, r, equations, surface.segment[i])
    return cost


class Workspace(NamedTuple):
    """Arrays of the fit of one body to one view of a person, allocated once for all its iterations.

    ``cost`` (4,) has the last iteration's sums of weighted squares: points, free space, joints, floor.
    """

    surface: Surface
    nodes: Any
    zbuffer: Any
    mass: Any
    pull: Any
    seen: Any
    visible: Any
    cost: Any


@njit(cache=True)
def make_workspace(target, body):
    """Allocate the arrays of a fit."""
    count = body.normals.shape[0]
    return Workspace(
        Surface(np.empty((count, 3)), np.empty((count, 3)), body.skin.influence[:, 0]),
        np.empty(body.skin.nodes.shape),
        np.empty(target.coarse.depth.shape, np.float32),
        np.empty(count),
        np.empty((count, 3)),
        np.empty(count, np.bool_),
        np.empty(count, np.bool_),
        np.zeros(4),
    )


@njit(cache=True)
def make_equations(body):
    """Allocate the normal equations of a body's segments."""
    count = body.skin.nodes.shape[0]
    return Equations(np.empty((count, 6, 6)), np.empty((count, 6)))


@njit(cache=True)
def add_view(target, body, settings, sigma, k, scale, rotations, root, work, equations):
    """Run the E-step of iteration ``k`` for one view, and set up the view's equations for the M-step.

    All is in the view's camera frame. Returns the amount of data: the number of points relative to
    `USUAL_POINTS`.
    """
    surface, nodes, visible, coarse = work.surface, work.nodes, work.visible, target.coarse
    stride = _THIN if sigma > settings.coarse_sigma else 1
    skin(body.skin, rotations, root, scale, surface.vertices, nodes)
    turn_normals(body.normals, body.skin.influence, rotations, surface.normals)
    if k % _LOOK_EVERY == 0:
        rasterize(surface.vertices, body.skin.faces, coarse.camera, work.zbuffer)
        mark_visible(surface.vertices, surface.normals, work.zbuffer, coarse.camera, _BEHIND_M, work.seen)
    visible[:] = work.seen
    if stride > 1:  # half of the vertices are enough for a subset of the points
        visible[k % 2 :: 2] = False
    assign(target.points, stride, surface.vertices, visible, sigma, settings.outlier, work.mass, work.pull)
    equations.inertia[:] = 0.0
    equations.force[:] = 0.0
    work.cost[0] = add_points(surface, work.mass, work.pull, root, settings, equations)
    # scale all other terms with the number of points
    amount = target.points.shape[0] / stride / USUAL_POINTS
    weight = 2.0 * settings.free_space_weight * amount
    work.cost[1] = add_free_space(surface, target.full, target.nearest, root, weight, settings, equations)
    # the mixture lacks its 1/sigma^2; points whose noise is shared count as fewer
    fewer = min(max(target.noise / _USUAL_NOISE_M, 1.0), _MOST_NOISE) ** 2
    weight = settings.proposal_weight * fewer * sigma**2 * amount
    work.cost[2] = add_proposals(target.proposals, body.feet, surface, nodes, root, weight, equations)
    weight = settings.floor_weight * sigma**2 * amount
    work.cost[3] = add_floor(surface, body.feet, target.floor, root, weight, equations)
    return amount


@njit(cache=True)
def fit(target, body, settings, sigmas, scale, rotations, root):
    """Run one iteration per sigma; ``rotations`` and ``root`` hold the start and are updated in place.

    Returns the last iteration's cost by term (4,), its normal equations (P, P), and its step (P,).
    """
    work, equations = make_workspace(target, body), make_equations(body)
    moved = np.zeros(body.above.shape[0])
    matrix, step = np.zeros((moved.shape[0], moved.shape[0])), np.zeros(moved.shape[0])
    for k in range(sigmas.shape[0]):
        amount = add_view(target, body, settings, sigmas[k], k, scale, rotations, root, work, equations)
        matrix, step = take_step(equations, body, settings, amount, work.nodes, moved, rotations, root)
    return work.cost, matrix, step
