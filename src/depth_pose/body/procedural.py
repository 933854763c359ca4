"""The embedded body: an average adult that ships as a file, in any build.

``tools/body/make_template.py`` makes the file from tables of proportions. Other builds move its
mesh, so all of them share faces and corresponding vertices.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.body import Body
from depth_pose.body.files import load_body
from depth_pose.core.errors import ConfigError
from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX, NODE_PARENTS, NODES

Array = NDArray[np.float64]

TEMPLATE = Path(__file__).parent / "data" / "procedural.npz"
"""Body of `BodyShape()`; its arrays ``made_by`` and ``sources_sha256`` say what made it."""


@dataclass(frozen=True)
class BodyShape:
    """Build of a person; every factor is relative to the average adult.

    Attributes
    ----------
    stature_m : float
        Height standing upright, metres; the factors below change proportions, not it.
    girth : float
        Thickness of limbs and trunk.
    shoulder_width, hip_width : float
        Distance of the shoulder and of the hip joints from the mid-plane.
    leg_length, arm_length, trunk_length : float
        Length of the segments.
    head_size : float
        Size of the head; about 1.25 for a child of 1.2 m.
    trunk_depth : float
        Thickness of the trunk from front to back, beside `girth`.
    """

    stature_m: float = ADULT_STATURE_M
    girth: float = 1.0
    shoulder_width: float = 1.0
    hip_width: float = 1.0
    leg_length: float = 1.0
    arm_length: float = 1.0
    trunk_length: float = 1.0
    head_size: float = 1.0
    trunk_depth: float = 1.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            low, high = (0.3, 2.5) if f.name == "stature_m" else (0.5, 2.0)
            if not low <= value <= high:
                raise ConfigError(f"BodyShape.{f.name} is {value}; it must be from {low} to {high}")


def make_body(shape: BodyShape | None = None) -> Body:
    """Make the embedded body in a build.

    Bodies of all builds have the same faces and corresponding vertices. Deterministic.
    """
    shape = BodyShape() if shape is None else shape
    template = _template()
    if shape == BodyShape():
        return template
    nodes, stretch = _shaped_nodes(template.nodes, shape)
    # each segment maps a point x to stretch (x - node) + new node; a vertex takes the weighted mean of maps
    shift = nodes - (stretch @ template.nodes[..., None])[..., 0]
    maps = template.weights @ np.concatenate([stretch.reshape(-1, 9), shift], axis=1)
    vertices = (maps[:, :9].reshape(-1, 3, 3) @ template.vertices[..., None])[..., 0] + maps[:, 9:]
    low, high = float(vertices[:, 1].min()), float(vertices[:, 1].max())
    factor = shape.stature_m / (high - low)
    floor = np.array([0.0, low, 0.0])
    return Body(
        name="procedural",
        vertices=(vertices - floor) * factor,
        faces=template.faces,
        weights=template.weights,
        nodes=(nodes - floor) * factor,
        stature=shape.stature_m,
    )


@lru_cache(maxsize=1)
def _template() -> Body:
    """Read the body of `BodyShape()`."""
    return load_body(TEMPLATE)  # writable: for other arrays all kernels would be compiled once more


def _shaped_nodes(nodes: Array, shape: BodyShape) -> tuple[Array, Array]:
    """Node positions (21, 3) and each segment's stretch (21, 3, 3) in a build, before the stature."""
    factors = _node_factors(shape)
    placed = nodes.copy()
    for i, name in enumerate(NODES):
        parent = int(NODE_PARENTS[i])
        if parent < 0:
            continue
        placed[i] = placed[parent] + factors[name] * (nodes[i] - nodes[parent])
    return placed, np.stack([_stretch(name, nodes, shape) for name in NODES])


def _node_factors(shape: BodyShape) -> dict[str, Array]:
    """Factor per axis on the offset of each node from its parent."""
    along = {"hip": shape.trunk_length, "knee": shape.leg_length, "ankle": shape.leg_length}
    factors: dict[str, Array] = {}
    for name in NODES:
        bare = name.removeprefix("left_").removeprefix("right_")
        if bare in ("elbow", "wrist"):
            f = np.full(3, shape.arm_length)
        elif bare in ("knee", "ankle", "foot"):
            f = np.full(3, along.get(bare, shape.leg_length))
        elif bare in ("shoulder", "clavicle"):
            f = np.array([shape.shoulder_width, shape.trunk_length, shape.girth])
        elif bare == "hip":
            f = np.array([shape.hip_width, shape.trunk_length, shape.girth])
        elif bare == "head":
            f = np.array([1.0, shape.trunk_length, shape.head_size])
        else:
            f = np.array([1.0, shape.trunk_length, shape.girth])
        factors[name] = f
    return factors


def _stretch(name: str, nodes: Array, shape: BodyShape) -> Array:
    """Linear map of a segment's surface about its node."""
    bare = name.removeprefix("left_").removeprefix("right_")
    if bare == "head":
        return shape.head_size * np.eye(3)
    if bare in ("wrist", "ankle", "foot"):
        return (shape.arm_length if bare == "wrist" else shape.leg_length) * np.eye(3)
    if bare in ("shoulder", "elbow", "hip", "knee"):
        child = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}[bare]
        bone = nodes[NODE_INDEX[name.replace(bare, child)]] - nodes[NODE_INDEX[name]]
        bone = bone / np.linalg.norm(bone)
        length = shape.arm_length if bare in ("shoulder", "elbow") else shape.leg_length
        along = np.outer(bone, bone)
        return length * along + shape.girth * (np.eye(3) - along)
    wide = {"pelvis": shape.hip_width, "spine": 0.5 * (shape.hip_width + shape.shoulder_width)}
    width = wide.get(bare, shape.shoulder_width if bare in ("chest", "clavicle") else 1.0)
    depth = shape.girth * (shape.trunk_depth if bare in (*wide, "chest") else 1.0)
    return np.diag([shape.girth * width, shape.trunk_length, depth])
