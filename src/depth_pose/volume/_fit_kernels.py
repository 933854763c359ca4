"""Kernels of `depth_pose.volume.fit`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from depth_pose.body._skin_kernels import skin
from depth_pose.core.kernels import njit
from depth_pose.refine._articulated_kernels import USUAL_POINTS, Surface, add_points, assign
from depth_pose.refine._tree_kernels import Equations, take_step
from depth_pose.refine._visibility_kernels import turn_normals


class Settings(NamedTuple):
    """Numbers of `depth_pose.volume.tuning.VolumeFitTuning` under their names."""

    sigmas: NDArray[np.float64]
    outlier: float
    plane_weight: float
    point_weight: float
    prior: float
    root_prior: float
    damping: float
    max_step: float


@njit(cache=True)
def fit_volume(points, eyes, body, trust, settings, scale, rotations, root):
    """Run all iterations; ``rotations`` and ``root`` hold the start and are overwritten with the fit.

    With ``eyes`` (n, 3), only vertices that face one of them are on the surface. Returns the root mean
    square distance of the trusted vertices from the points assigned to them, along the normals, and the
    factor on the body's size that would minimise it.
    """
    count = body.normals.shape[0]
    vertices, normals = np.empty((count, 3)), np.empty((count, 3))
    surface = Surface(vertices, normals, body.skin.influence[:, 0])
    nodes, used = np.empty(body.skin.nodes.shape), np.empty(count, np.bool_)
    mass, pull = np.empty(count), np.empty((count, 3))
    equations = Equations(np.empty((nodes.shape[0], 6, 6)), np.empty((nodes.shape[0], 6)))
    moved = np.zeros(body.above.shape[0])
    amount = points.shape[0] / USUAL_POINTS
    residual, factor = 0.0, 1.0
    for k in range(settings.sigmas.shape[0]):
        skin(body.skin, rotations, root, scale, vertices, nodes)
        turn_normals(body.normals, body.skin.influence, rotations, normals)
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
        assign(points, 1, vertices, used, settings.sigmas[k], settings.outlier, mass, pull)
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
        equations.inertia[:] = 0.0
        equations.force[:] = 0.0
        add_points(surface, mass, pull, root, settings, equations)
        take_step(equations, body, settings, amount, nodes, moved, rotations, root)
    return residual, factor
