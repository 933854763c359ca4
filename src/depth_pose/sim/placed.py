"""People at their places in a room, dressed in materials of some reflectance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.skeleton import JOINT_INDEX
from depth_pose.sim.materials import Wardrobe
from depth_pose.sim.people import Figure
from depth_pose.sim.shapes import random_albedo

Array = NDArray[np.float64]

_FEET = [(JOINT_INDEX[f"{side}_foot"], JOINT_INDEX[f"{side}_ankle"]) for side in ("left", "right")]


@dataclass(frozen=True)
class Placed:
    """A person at their place in the room frame, metres.

    Attributes
    ----------
    vertices, held_vertices : (V, 3) float64
    joints : (19, 3) float64
    heels : (2, 3) float64
    faces, held_faces : (F, 3) int64
    albedo : (F,) float32
        Of `faces`.
    held_albedo : float
    fabrics : tuple of str
        Materials of hair, top, trousers and shoes (`depth_pose.sim.materials.WORN`); empty where unknown.
    """

    vertices: Array
    faces: NDArray[np.int64]
    joints: Array
    heels: Array
    held_vertices: Array
    held_faces: NDArray[np.int64]
    albedo: NDArray[np.float32]
    held_albedo: float
    fabrics: tuple[str, ...] = ()


def place(
    figure: Figure,
    x: float,
    z: float,
    turn: float,
    rng: np.random.Generator,
    wardrobe: Wardrobe | None = None,
) -> Placed:
    """Stand a figure on a spot of the floor, turned about the vertical, in clothes of random albedo.

    With a wardrobe the clothes are of its materials.
    """
    c, s = np.cos(turn), np.sin(turn)
    turned = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    moved = [
        points.astype(np.float64).reshape(-1, 3) @ turned.T + np.array([x, 0.0, z])
        for points in (figure.vertices, figure.joints, figure.heels, figure.held_vertices)
    ]
    return Placed(
        vertices=moved[0],
        faces=figure.faces.astype(np.int64),
        joints=moved[1],
        heels=moved[2],
        held_vertices=moved[3],
        held_faces=figure.held_faces.astype(np.int64).reshape(-1, 3),
        albedo=_person_albedo(figure, rng) if wardrobe is None else _dressed_albedo(figure, wardrobe),
        held_albedo=random_albedo(rng, 0.3),
        fabrics=() if wardrobe is None else wardrobe.names,
    )


def _person_albedo(figure: Figure, rng: np.random.Generator) -> NDArray[np.float32]:
    """Albedo of each triangle: skin, hair, shirt or trousers, by its place on the body."""
    shirt, trousers, hair = random_albedo(rng, 0.12), random_albedo(rng, 0.15), random_albedo(rng, 0.3)
    return _paint(figure, hair, shirt, trousers)


def _dressed_albedo(figure: Figure, wardrobe: Wardrobe) -> NDArray[np.float32]:
    """Return the same of a wardrobe, with shoes."""
    hair, top, trousers, shoes = wardrobe.albedos
    albedo = _paint(figure, hair, top, trousers)
    middles = figure.vertices[figure.faces[:, 0]]
    for foot, ankle in _FEET:
        toe, heel = figure.joints[foot], figure.joints[ankle]
        reach = 0.75 * float(np.linalg.norm(toe - heel)) + 0.02
        off = middles - (0.6 * toe + 0.4 * heel)
        albedo[np.einsum("ij,ij->i", off, off) < reach**2] = shoes
    return albedo


def _paint(figure: Figure, hair: float, shirt: float, trousers: float) -> NDArray[np.float32]:
    """Paint each triangle by its place on the body."""
    middles = figure.vertices[figure.faces[:, 0]]
    joints = figure.joints
    neck, head, pelvis = (joints[JOINT_INDEX[n]] for n in ("neck", "head", "pelvis"))
    trunk = (neck - pelvis) / max(float(np.linalg.norm(neck - pelvis)), 1e-6)
    along = (middles - pelvis) @ trunk
    albedo = np.where(along > 0.03, shirt, trousers)
    off = middles - head
    on_head = np.einsum("ij,ij->i", off, off) < (1.3 * np.linalg.norm(head - neck) + 0.06) ** 2
    skull = (head - neck) / max(float(np.linalg.norm(head - neck)), 1e-6)
    above = off @ skull > 0.02
    return np.where(on_head, np.where(above, hair, 0.6), albedo).astype(np.float32)
