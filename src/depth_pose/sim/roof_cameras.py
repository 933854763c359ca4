"""Cameras under the roof around a space, with their silhouettes and depth images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.body.rendered_depth import render_depth
from depth_pose.core.camera import Camera
from depth_pose.rooms.rig import RigCamera, look_at
from depth_pose.sim.sensor import Mesh

ROOF_CAMERA = Camera(256, 192, 190.0, 190.0, 127.5, 95.5)
"""A quarter of the paper's 1024 x 768 along each side; 68 degrees wide."""

FRONT_CAMERA = Camera(320, 240, 228.0, 228.0, 159.5, 119.5)
"""A small depth camera, 70 degrees wide."""

MIDDLE_M = (0.0, 0.95, 0.0)
"""Target of all cameras: the middle of a person in the middle of the space, metres."""


def roof_rig(
    count: int = 8, radius: float = 3.6, height: float = 2.8, camera: Camera = ROOF_CAMERA
) -> tuple[RigCamera, ...]:
    """Cameras on a circle that look at the middle, evenly spaced (the paper has 8)."""
    return _ring("camera", count, radius, height, camera)


def front_camera(distance: float = 3.4, height: float = 1.3, azimuth: float = 0.0) -> RigCamera:
    """One depth camera at the height of a table or shelf, 320 x 240, 70 degrees wide."""
    return _ring("depth", 1, distance, height, FRONT_CAMERA, azimuth)[0]


def depth_ring(count: int, distance: float = 3.4, height: float = 1.3) -> tuple[RigCamera, ...]:
    """Depth cameras like `front_camera`, evenly spaced on a circle, the first one in front."""
    return _ring("depth", count, distance, height, FRONT_CAMERA)


def _ring(
    name: str, count: int, radius: float, height: float, camera: Camera, first: float = 0.0
) -> tuple[RigCamera, ...]:
    azimuths = first + 2 * np.pi * np.arange(count) / count
    eyes = [[radius * np.sin(a), height, radius * np.cos(a)] for a in azimuths]
    return tuple(RigCamera(f"{name}{k}", camera, look_at(eye, MIDDLE_M)) for k, eye in enumerate(eyes))


class RigRenderer:
    """Renderer of the images of a rig's cameras."""

    def __init__(self, rig: Sequence[RigCamera]) -> None:
        self.rig = tuple(rig)

    def images(self, meshes: Sequence[Mesh], kind: str) -> tuple[NDArray[np.generic], ...]:
        """Return each camera's image of meshes in the world frame: ``silhouettes`` or ``depth``."""
        return tuple(self.silhouettes(meshes) if kind == "silhouettes" else self.depths(meshes))

    def depths(self, meshes: Sequence[Mesh]) -> list[NDArray[np.float32]]:
        """Depth images (H, W) of meshes in the world frame, metres, 0 where there is nothing."""
        vertices, faces = join_meshes(meshes)
        out = []
        for c in self.rig:
            depth = render_depth(c.to_camera(vertices), faces, c.camera)
            out.append(np.where(np.isfinite(depth), depth, 0.0).astype(np.float32))
        return out

    def silhouettes(self, meshes: Sequence[Mesh]) -> list[NDArray[np.uint8]]:
        """Silhouettes (H, W) of meshes in the world frame, 255 on the meshes."""
        return [np.where(depth > 0, np.uint8(255), np.uint8(0)) for depth in self.depths(meshes)]


def join_meshes(meshes: Sequence[Mesh]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Combine meshes into one."""
    vertices = np.concatenate([np.asarray(v, np.float64) for v, _ in meshes])
    first = np.cumsum([0] + [len(v) for v, _ in meshes[:-1]])
    faces = np.concatenate([np.asarray(f) + n for (_, f), n in zip(meshes, first, strict=True)])
    return vertices, faces.astype(np.int32)


def roughen(
    silhouette: NDArray[np.uint8], rng: np.random.Generator, edge: float, specks: float
) -> NDArray[np.uint8]:
    """Add errors of background subtraction to a silhouette.

    Parameters
    ----------
    silhouette : (H, W) uint8
    rng : numpy.random.Generator
    edge : float
        Probability that a pixel at the outline is flipped.
    specks : float
        Share of all pixels that are flipped.
    """
    inside = silhouette > 0
    around = np.zeros_like(inside)
    around[1:] |= inside[1:] != inside[:-1]
    around[:-1] |= inside[1:] != inside[:-1]
    around[:, 1:] |= inside[:, 1:] != inside[:, :-1]
    around[:, :-1] |= inside[:, 1:] != inside[:, :-1]
    chance = np.where(around, edge, specks)
    return np.where(inside ^ (rng.uniform(size=inside.shape) < chance), np.uint8(255), np.uint8(0))
