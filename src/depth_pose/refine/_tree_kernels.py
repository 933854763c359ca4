"""Compiled loops for a body that is a tree of segments: normal equations, solution, rotations.

`depth_pose.refine.articulated` derives them; the fit to a volume takes the same steps.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body._skin_kernels import Skin
from depth_pose.core._rotation_kernels import multiply, rotation_of
from depth_pose.core.kernels import njit

_HOLD = 1e-6
"""Added to the diagonal of the normal equations, so that unobserved parts have a solution."""


class Feet(NamedTuple):
    """Soles and heels of both feet.

    Attributes
    ----------
    soles : (S,) int64
        The lowest vertices of the balls and heels in the rest pose.
    is_heel : (S,) bool
    share : (S,) float64
        One over the number of vertices of the same ball or heel.
    heels, ankles : (2,) int64
        The rearmost vertices of the left and the right foot, and the nodes of their ankles.
    """

    soles: NDArray[np.int64]
    is_heel: NDArray[np.bool_]
    share: NDArray[np.float64]
    heels: NDArray[np.int64]
    ankles: NDArray[np.int64]


class Articulation(NamedTuple):
    """A body prepared for pose fits (by `depth_pose.refine.articulated.articulate`).

    Attributes
    ----------
    skin : Skin
    normals : (V, 3) float64
        Normals of the rest vertices, outward.
    free : (21,) int64
        Index of each node among the free ones, -1 for those that follow their parent.
    above : (3 + 3 F,) int64
        Number of each parameter's next one toward the root, -1 for none: three of the translation,
        then three of each free node.
    stiffness : (F,) float64
        Stiffness of each free node toward the start.
    neutral : (F, 3) float64
        Stiffness of each free node toward its rest pose relative to its parent, about the parent's axes.
    feet : Feet
    """

    skin: Skin
    normals: NDArray[np.float64]
    free: NDArray[np.int64]
    above: NDArray[np.int64]
    stiffness: NDArray[np.float64]
    neutral: NDArray[np.float64]
    feet: Feet


class Equations(NamedTuple):
    """Normal equations of each segment's free rigid motion: (21, 6, 6) and (21, 6) float64."""

    inertia: Any
    force: Any


@njit(cache=True, fastmath=True, forceinline=True)
def add_vertex(v, origin, m, r, equations, segment):
    """Add one vertex to its segment's normal equations for a free motion ``w x (v - origin) + t``.

    ``m`` is a symmetric 3x3 metric, ``r`` the residual; the equations take ``J' m J`` and ``J' m r``
    with the Jacobian ``J = [-[v - origin]_x, 1]``.
    """
    inertia, force = equations.inertia[segment], equations.force[segment]
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


@njit(cache=True, fastmath=True, forceinline=True)
def assemble(equations, body, nodes, origin, matrix, gradient):
    """Assemble the normal equations of the joint angles from those of the free segments.

    A turn of node k moves all segments below it together, so their inertias are summed up the tree. The block
    of two nodes is that of the lower one's sum if one lies above the other, else zero. The equations are
    overwritten.
    """
    inertia, force = equations.inertia, equations.force
    parents, free = body.skin.parents, body.free
    count = parents.shape[0]
    for n in range(count):  # the kernel above fills only the lower left block
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
        for i in range(6):  # inertia times [1; [p]_x], the motion of a rotation about the node
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
def update(step, body, rotations):
    """Rotate every node's segment by the steps of its free ancestors, the root's first."""
    parents, free = body.skin.parents, body.free
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
    """Solve ``matrix x = right`` in place for parameters that are coupled only along a tree.

    Factorises ``L' D L`` from the leaves up, without fill-in (R. Featherstone, *Efficient factorization of
    the joint-space inertia matrix for branched kinematic trees*, 2005). ``above`` (n,) is each parameter's
    next one toward the root, with a lower number; -1 for none. Only the lower triangle is read, and it is
    overwritten.
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
def hold_neutral(body, weight, rotations, matrix, gradient):
    """Pull nodes' rotations from their parents' toward the rest pose, about each of the parent's axes."""
    parents, free, stiffness = body.skin.parents, body.free, body.neutral
    for n in range(1, parents.shape[0]):
        f = free[n]
        if f < 0 or stiffness[f].max() <= 0.0:
            continue
        above, own, c = rotations[parents[n]], rotations[n], 3 + 3 * f
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            turned = 0.0  # sine of the rotation about axis i
            for a in range(3):
                turned += 0.5 * (above[a, k] * own[a, j] - above[a, j] * own[a, k])
            for a in range(3):
                hold = weight * stiffness[f, i] * above[a, i]
                gradient[c + a] -= hold * turned
                for b in range(3):
                    matrix[c + a, c + b] += hold * above[b, i]


@njit(cache=True)
def take_step(equations, body, settings, amount, nodes, moved, rotations, root):
    """Take one damped Gauss-Newton step.

    ``rotations`` and ``root`` are updated in place, and ``moved`` (P,) accumulates the steps. ``settings``
    has damping, prior and root_prior, which scale with the ``amount`` of data, and max_step, radians.

    Returns the normal equations (P, P) that were solved, and the step (P,).
    """
    size = moved.shape[0]
    matrix, gradient = np.zeros((size, size)), np.empty(size)
    assemble(equations, body, nodes, root, matrix, gradient)
    for i in range(size):
        matrix[i, i] += _HOLD + settings.damping * amount
        hold = settings.root_prior * amount
        if i >= 3:
            hold = settings.prior * amount * body.stiffness[(i - 3) // 3]
        matrix[i, i] += hold
        gradient[i] -= hold * moved[i]
    hold_neutral(body, settings.prior * amount, rotations, matrix, gradient)
    solved = matrix.copy()
    solve_tree(matrix, body.above, gradient)
    most = np.abs(gradient[3:]).max()
    if most > settings.max_step:
        gradient *= settings.max_step / most
    update(gradient, body, rotations)
    root += gradient[:3]
    moved += gradient
    return solved, gradient
