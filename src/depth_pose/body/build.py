r"""Personal builds: one body, stretched limb by limb to the proportions of a person.

A build is a short vector :math:`\beta`: the relative change in length, width or thickness of each part
against the template at the same overall size (0.05: 5 %), equal on both sides. The rest pose moves linearly
with it,

.. math:: v(\beta) = v_0 + \sum_k \beta_k D_k, \qquad c(\beta) = c_0 + \sum_k \beta_k N_k,

and since linear blend skinning is linear in the rest pose for given rotations, the derivative of a
posed body by :math:`\beta_k` is the posed :math:`(D_k, N_k)` itself. That is the linear shape space of
M. Ye and R. Yang, *Real-time simultaneous pose and shape estimation for articulated objects using a
single depth camera* (CVPR 2014), with stretched segments instead of free bone scales.

How much people differ (`SPREAD`, `CORRELATION`) is computed from the public measurements of the US
Army's ANSUR II survey (C. Gordon et al., *2012 Anthropometric Survey of U.S. Army Personnel: Methods
and Summary Statistics*, NATICK/TR-15/007, 2014), 4082 men and 1986 women, each sex with half of the
weight: standard deviations and correlations of the logarithm of each measure's ratio to stature.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.core.skeleton import NODE_INDEX, NODE_PARENTS, NODES

Array = NDArray[np.float64]

BUILD_NAMES: tuple[str, ...] = (
    "trunk_length",
    "neck_head",
    "shoulder_width",
    "hip_width",
    "upper_arm",
    "forearm",
    "thigh",
    "shank",
    "foot",
    "trunk_breadth",
    "trunk_depth",
    "arm_girth",
    "leg_girth",
)
"""Parts of a build, in the order of every (13,) array."""

_LENGTHS = 9
"""Number of lengths and widths of bones, which come first; the others are girths."""

SPREAD: Array = np.array(
    [0.044, 0.054, 0.050, 0.074, 0.033, 0.045, 0.049, 0.044, 0.041, 0.072, 0.109, 0.074, 0.079]
)
"""Standard deviation of each part among adults of the same stature. The measures, in ANSUR II's names:
cervicale less trochanterion height; stature less cervicale height; biacromial breadth; bicristal breadth;
acromion-radiale length; radiale-stylion length; trochanterion less lateral femoral epicondyle height; that
less lateral malleolus height; ball of foot length; the geometric means of chest, waist and hip breadth, of
chest, waist and buttock depth, of flexed biceps, flexed forearm and wrist circumference, and of thigh, lower
thigh and calf circumference."""

CORRELATION: Array = np.array(
    [
        [1.00, -0.24, 0.30, 0.00, -0.24, -0.18, -0.67, -0.59, -0.01, 0.11, 0.06, 0.30, -0.01],
        [-0.24, 1.00, -0.25, 0.18, -0.25, -0.38, -0.20, -0.09, -0.22, 0.05, -0.11, -0.27, 0.09],
        [0.30, -0.25, 1.00, -0.10, 0.02, 0.27, -0.05, -0.28, 0.32, 0.16, 0.20, 0.55, 0.10],
        [0.00, 0.18, -0.10, 1.00, 0.04, -0.27, -0.14, 0.06, -0.07, 0.75, 0.54, 0.11, 0.55],
        [-0.24, -0.25, 0.02, 0.04, 1.00, 0.32, 0.18, 0.35, 0.12, 0.07, 0.13, 0.04, 0.05],
        [-0.18, -0.38, 0.27, -0.27, 0.32, 1.00, 0.26, 0.21, 0.38, -0.15, 0.03, 0.22, -0.07],
        [-0.67, -0.20, -0.05, -0.14, 0.18, 0.26, 1.00, 0.03, 0.03, -0.16, -0.04, -0.08, -0.13],
        [-0.59, -0.09, -0.28, 0.06, 0.35, 0.21, 0.03, 1.00, 0.11, -0.04, 0.00, -0.25, 0.08],
        [-0.01, -0.22, 0.32, -0.07, 0.12, 0.38, 0.03, 0.11, 1.00, 0.06, 0.17, 0.38, 0.16],
        [0.11, 0.05, 0.16, 0.75, 0.07, -0.15, -0.16, -0.04, 0.06, 1.00, 0.85, 0.49, 0.79],
        [0.06, -0.11, 0.20, 0.54, 0.13, 0.03, -0.04, 0.00, 0.17, 0.85, 1.00, 0.63, 0.78],
        [0.30, -0.27, 0.55, 0.11, 0.04, 0.22, -0.08, -0.25, 0.38, 0.49, 0.63, 1.00, 0.53],
        [-0.01, 0.09, 0.10, 0.55, 0.05, -0.07, -0.13, 0.08, 0.16, 0.79, 0.78, 0.53, 1.00],
    ]
)
"""Correlations of the parts, (13, 13)."""

_X, _Y, _Z = (np.diag(row) for row in np.eye(3))
"""A part that stretches one axis."""
_ALL = np.eye(3)
"""A part that stretches all three axes alike."""

_OFFSETS: dict[str, tuple[tuple[str, ...], Array]] = {
    "trunk_length": (("spine", "chest", "neck", "clavicle", "shoulder"), _Y),
    "neck_head": (("head",), _ALL),
    "shoulder_width": (("clavicle", "shoulder"), _X),
    "hip_width": (("hip",), _X),
    "upper_arm": (("elbow",), _ALL),
    "forearm": (("wrist",), _ALL),
    "thigh": (("knee",), _ALL),
    "shank": (("ankle",), _ALL),
    "foot": (("foot",), _ALL),
}
"""For each part: the joints (without side) whose offset from the parent it scales, and along which axis."""

_ALONG, _ACROSS = "along", "across"

_SURFACES: dict[str, tuple[tuple[str, Array | str], ...]] = {
    "trunk_length": (("spine", _Y), ("chest", _Y), ("clavicle", _Y)),
    "neck_head": (("neck", _Y), ("head", _ALL)),
    "shoulder_width": (("spine", 0.5 * _X), ("chest", _X), ("clavicle", _X)),
    "hip_width": (("pelvis", _X), ("spine", 0.5 * _X)),
    "upper_arm": (("shoulder", _ALONG),),
    "forearm": (("elbow", _ALONG), ("wrist", _ALL)),
    "thigh": (("hip", _ALONG),),
    "shank": (("knee", _ALONG),),
    "foot": (("ankle", _ALL), ("foot", _ALL)),
    "trunk_breadth": (("pelvis", _X), ("spine", _X), ("chest", _X), ("clavicle", _X)),
    "trunk_depth": (("pelvis", _Z), ("spine", _Z), ("chest", _Z), ("clavicle", _Z)),
    "arm_girth": (("shoulder", _ACROSS), ("elbow", _ACROSS)),
    "leg_girth": (("hip", _ACROSS), ("knee", _ACROSS)),
}
"""For each part: the segments whose skin it scales about their node, along or across the bone, or per
axis."""

_NEXT = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}
"""The node at the end of each long bone."""

MOST: Array = np.where([name == "trunk_depth" for name in BUILD_NAMES], 0.6, 0.3)
"""Maximum deviation of each part, (13,): four to six standard deviations for most; coats make a trunk up to
50 % deeper."""

KEPT = 64
"""Number of cached bodies; a person's build seldom changes."""


class BuildSpace:
    """All builds of one body.

    Attributes
    ----------
    template : Body
        The body of build 0.
    vertices, nodes : (13, V, 3), (13, 21, 3) float64
        Derivatives of the rest pose by each part, metres.
    """

    def __init__(self, template: Body) -> None:
        self.template = template
        self.nodes, maps = _derivatives(template.nodes)
        arms = template.vertices[:, None, :] - template.nodes
        self.vertices = np.ascontiguousarray(
            [
                np.einsum("vn,vni->vi", template.weights, np.einsum("nij,vnj->vni", m, arms) + n)
                for m, n in zip(maps, self.nodes, strict=True)
            ]
        )
        self._body: Callable[[bytes], Body] = lru_cache(maxsize=KEPT)(self._make)

    def body(self, build: NDArray[np.float32]) -> Body:
        """Return the body of a build, (13,) float32; the template where it is 0 or empty.

        Its weights, faces and stature are the template's: sizes stay relative to the same stature.
        """
        return self._body(build.tobytes()) if build.any() else self.template

    def _make(self, values: bytes) -> Body:
        build = np.frombuffer(values, np.float32).astype(np.float64)
        template = self.template
        vertices = template.vertices + combine(build, self.vertices)
        return template.reshaped(vertices, template.nodes + combine(build, self.nodes))


def combine(weights: Array, parts: Array) -> Array:
    """Return the weighted sum of parts, (n,) and (n, ...); `np.tensordot` checks more."""
    return weights[None].dot(parts.reshape(len(parts), -1)).reshape(parts.shape[1:])


@lru_cache(maxsize=2)
def build_space(template: Body) -> BuildSpace:
    """Return the shared space of all builds of a body."""
    return BuildSpace(template)


def prior_information() -> Array:
    """Inverse covariance of builds among adults, (13, 13).

    Lengths and girths are treated as independent: girths also absorb what clothes add and what sensor noise
    and smoothing remove from thin limbs, and bone lengths must not follow.
    """
    covariance = CORRELATION * np.outer(SPREAD, SPREAD)
    covariance[:_LENGTHS, _LENGTHS:] = covariance[_LENGTHS:, :_LENGTHS] = 0.0
    return np.asarray(np.linalg.inv(covariance))


def _derivatives(nodes: Array) -> tuple[Array, Array]:
    """Return the derivatives of the nodes, (13, 21, 3), and of the segments' linear maps, (13, 21, 3, 3)."""
    count = len(BUILD_NAMES)
    moved, maps = np.zeros((count, len(NODES), 3)), np.zeros((count, len(NODES), 3, 3))
    for k, part in enumerate(BUILD_NAMES):
        kinds, factor = _OFFSETS.get(part, ((), _ALL))
        surfaces = dict(_SURFACES[part])
        for i, name in enumerate(NODES):
            parent, kind = int(NODE_PARENTS[i]), name.split("_")[-1]
            if parent >= 0:
                moved[k, i] = moved[k, parent]
            if kind in kinds:
                moved[k, i] += factor @ (nodes[i] - nodes[parent])
            if kind in surfaces:
                maps[k, i] = _surface_map(nodes, name, surfaces[kind])
    return moved, maps


def _surface_map(nodes: Array, name: str, how: Array | str) -> Array:
    if not isinstance(how, str):
        return how
    kind = name.split("_")[-1]
    bone = nodes[NODE_INDEX[name.replace(kind, _NEXT[kind])]] - nodes[NODE_INDEX[name]]
    along = np.outer(bone, bone) / (bone @ bone)
    return along if how == _ALONG else _ALL - along
