"""Skin weights of the embedded body.

Each vertex first gets weights from where it lies along the bones: across a joint they pass from
one segment to the next over a band about as wide as the limb (in metres below; set by hand on the
pictures that ``tools/body/draw_body.py`` draws of hard poses). A short diffusion over the mesh,
``(M + t L) w = M w0`` (one implicit step of the heat equation, as in I. Baran and J. Popovic,
*Automatic rigging and animation of 3D characters*, SIGGRAPH 2007), then removes every seam.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import splu

from anatomy import BodyField
from depth_pose.body.body import INFLUENCES
from depth_pose.core.skeleton import MIRROR_NODES, NODE_INDEX
from surface import Array, Mesh

_LEAST_WEIGHT = 0.01
"""Smaller weights are dropped."""
_DIFFUSION = 0.016**2
"""Diffusion time t, square metres: the square of the width over which seams are smoothed."""


def smooth_step(x: Array) -> Array:
    """0 below 0, 1 above 1, and 3 x^2 - 2 x^3 between."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def skin_weights(mesh: Mesh, nodes: Array, field: BodyField) -> Array:
    """Weights (V, 21) of a body in the reference rest pose whose left half comes first.

    Parameters
    ----------
    mesh : Mesh
        Symmetric mesh as `remesh.mirror` gives it.
    nodes : (21, 3)
        Rest positions of the nodes, metres.
    field : BodyField
        The surface that the mesh was made from.
    """
    left = mesh.vertices[:, 0] >= 0.0
    weights = np.zeros((len(mesh.vertices), len(NODE_INDEX)))
    folded = np.column_stack([np.abs(mesh.vertices[:, 0]), mesh.vertices[:, 1:]])
    half = _left_weights(folded, nodes, field)
    weights[left] = half[left]
    weights[~left] = half[~left][:, MIRROR_NODES]
    on_plane = mesh.vertices[:, 0] == 0.0
    weights[on_plane] = 0.5 * (weights + weights[:, MIRROR_NODES])[on_plane]
    weights = _diffuse(mesh, weights)
    return _symmetric(mesh, _truncate(weights))


def _left_weights(points: Array, nodes: Array, field: BodyField) -> Array:
    torso, arm, leg = field.parts(points)
    bare = field.trunk(points)
    at = {name: nodes[i] for name, i in NODE_INDEX.items()}
    w = _spine_weights(points, at)
    _move_clavicle(w, points, at)
    to_arm = smooth_step((np.minimum(bare, torso + 0.02) - arm) / 0.09 + 0.5)
    across = (points - at["left_shoulder"]) @ _unit(0.92, -0.39)
    _blend(w, _limb(points, at, ("shoulder", "elbow", "wrist")), to_arm * smooth_step(across / 0.10 + 0.4))
    off_midline = np.maximum(smooth_step(points[:, 0] / 0.06), smooth_step((0.80 - points[:, 1]) / 0.05))
    to_leg = smooth_step((torso - leg) / 0.09 + 0.6) * off_midline * smooth_step((arm - leg) / 0.06 + 0.5)
    across = (points - at["left_hip"]) @ _unit(0.60, -0.80)
    _blend(w, _limb(points, at, ("hip", "knee", "ankle")), to_leg * smooth_step(across / 0.16 + 0.38))
    return w


def _unit(x: float, y: float) -> Array:
    return np.array([x, y, 0.0]) / float(np.hypot(x, y))


def _blend(weights: Array, other: Array, share: Array) -> None:
    weights *= (1.0 - share)[:, None]
    weights += other * share[:, None]


def _spine_weights(points: Array, at: dict[str, Array]) -> Array:
    """Bands along the trunk, neck and head; the neck's and head's bands slope down to the front."""
    w = np.zeros((len(points), len(NODE_INDEX)))
    height = points[:, 1]
    tilted = height + 0.35 * (points[:, 2] - at["neck"][2])
    skull = height + 0.45 * (points[:, 2] - at["head"][2])
    w[:, NODE_INDEX["pelvis"]] = 1.0
    for name, level, width in (
        ("spine", height - at["spine"][1], 0.14),
        ("chest", height - at["chest"][1], 0.14),
        ("neck", tilted - at["neck"][1], 0.07),
        ("head", skull - at["head"][1], 0.06),
    ):
        share = smooth_step(level / width + 0.5)
        if name == "neck":
            share *= 1.0 - smooth_step((points[:, 0] - 0.06) / 0.07)
        w *= (1.0 - share)[:, None]
        w[:, NODE_INDEX[name]] = share
    return w


def _move_clavicle(w: Array, points: Array, at: dict[str, Array]) -> None:
    """Give the shoulder's surroundings to the clavicle."""
    start, end = at["left_clavicle"], at["left_shoulder"]
    reach = (points[:, 0] - start[0]) / (end[0] - start[0])
    share = smooth_step((reach - 0.25) / 0.65) * smooth_step((points[:, 1] - (end[1] - 0.12)) / 0.10)
    share *= 1.0 - w[:, NODE_INDEX["head"]] - w[:, NODE_INDEX["neck"]]
    chest = w[:, NODE_INDEX["chest"]] * np.clip(share, 0.0, 1.0)
    w[:, NODE_INDEX["chest"]] -= chest
    w[:, NODE_INDEX["left_clavicle"]] += chest


def _limb(points: Array, at: dict[str, Array], names: tuple[str, str, str]) -> Array:
    """Weights along a limb: upper, lower, hand or foot."""
    upper, lower, end = (f"left_{n}" for n in names)
    w = np.zeros((len(points), len(NODE_INDEX)))
    bones = [at[lower] - at[upper], at[end] - at[lower]]
    axes = [b / np.linalg.norm(b) for b in bones]
    middle = (axes[0] + axes[1]) / np.linalg.norm(axes[0] + axes[1])
    bend = smooth_step((points - at[lower]) @ middle / 0.09 + 0.5)
    last, width = axes[1], 0.05
    if names[2] == "ankle":
        last, width = np.array([0.0, -0.8, 0.6]), 0.06
    turn = smooth_step((points - at[end]) @ last / width + 0.5)
    w[:, NODE_INDEX[upper]] = 1.0 - bend
    w[:, NODE_INDEX[lower]] = bend * (1.0 - turn)
    w[:, NODE_INDEX[end]] = bend * turn
    return w


def _diffuse(mesh: Mesh, weights: Array) -> Array:
    stiffness, mass = cotangent_laplacian(mesh)
    system = (diags(mass) + _DIFFUSION * stiffness).tocsc()
    smooth: Array = splu(system).solve(mass[:, None] * weights)
    return np.clip(smooth, 0.0, None)


def cotangent_laplacian(mesh: Mesh) -> tuple[csc_matrix, Array]:
    """Stiffness matrix (V, V), positive semi-definite, and lumped masses (V,) of a mesh.

    Angles above 90 degrees count nothing: with negative entries the diffusion could overshoot.
    """
    n = len(mesh.vertices)
    rows, cols, data = [], [], []
    p = mesh.vertices[mesh.faces]
    area = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    mass = np.zeros(n)
    for k in range(3):
        a, b, c = (mesh.faces[:, (k + j) % 3] for j in range(3))
        u, v = p[:, (k + 1) % 3] - p[:, k], p[:, (k + 2) % 3] - p[:, k]
        cot = np.maximum((u * v).sum(axis=1) / np.maximum(2.0 * area, 1e-12), 0.0)
        for i, j, s in ((b, c, -0.5), (c, b, -0.5), (b, b, 0.5), (c, c, 0.5)):
            rows.append(i)
            cols.append(j)
            data.append(s * cot)
        np.add.at(mass, a, area / 3.0)
    matrix = coo_matrix((np.concatenate(data), (np.concatenate(rows), np.concatenate(cols))), shape=(n, n))
    return matrix.tocsc(), mass


def _truncate(weights: Array) -> Array:
    """Keep each row's greatest entries, drop the negligible, and make it sum to 1."""
    order = np.argsort(-weights, axis=1, kind="stable")[:, INFLUENCES:]
    kept = weights.copy()
    np.put_along_axis(kept, order, 0.0, axis=1)
    kept[kept < _LEAST_WEIGHT] = 0.0
    kept /= kept.sum(axis=1, keepdims=True)
    return kept


def _symmetric(mesh: Mesh, weights: Array) -> Array:
    """Copy the left half's weights to the right; on the mid-plane, average the two sides."""
    x = mesh.vertices[:, 0]
    middle, left = np.flatnonzero(x == 0.0), np.flatnonzero(x > 0.0)
    out = weights.copy()
    out[np.flatnonzero(x < 0.0)] = weights[left][:, MIRROR_NODES]
    both = 0.5 * (weights[middle] + weights[middle][:, MIRROR_NODES])
    both[(both > 0).sum(axis=1) > INFLUENCES] *= np.arange(len(MIRROR_NODES)) == MIRROR_NODES
    out[middle] = both / both.sum(axis=1, keepdims=True)
    return out
