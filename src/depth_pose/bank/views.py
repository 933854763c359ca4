"""Partial views of posed bodies: Open3D ray casting from around and above (Sec. 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank.canonical import canonical_axes, describe
from depth_pose.body.body import Body

VIEWS = 8
"""Views of each pose, one for every eighth of a turn."""

DISTANCE_M = 3.0
"""From the virtual camera to the middle of the body."""

_RAY_SPACING = 0.028 / DISTANCE_M
"""Tangent of the angle between neighbouring rays."""

_ELEVATIONS = np.radians([0.0, 8.0, 20.0, -8.0, 12.0, 4.0, 32.0, 50.0])
_CLOSE_ELEVATIONS = 6
"""The first ones, from -8 to 20 degrees, are what most sensors see; each pose gets one steep view."""


@dataclass(frozen=True)
class PoseViews:
    """Views of some poses.

    Attributes
    ----------
    descriptors : (N, 8, 2304) float16
    rotations : (N, 8, 3, 3) float32
        ``R_canonical_model``.
    origins : (N, 8, 3) float32
        Centroid of each partial cloud in the model frame, pelvis at the origin, metres.
    """

    descriptors: NDArray[np.float16]
    rotations: NDArray[np.float32]
    origins: NDArray[np.float32]


def view_rotation(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Rotation from the model frame to a camera that sees the body from a direction.

    Parameters
    ----------
    azimuth : float
        Radians; 0 is from the front, pi / 2 from the person's left.
    elevation : float
        Radians; positive is from above.
    """
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    toward = np.array([sa * ce, se, ca * ce])  # from the body to the camera
    right = np.array([ca, 0.0, -sa])
    return np.stack([right, np.cross(right, toward), -toward])


def view_directions(pose: int) -> NDArray[np.float64]:
    """Azimuth and elevation of every view of a pose, shape (8, 2), radians; fixed by its number."""
    turn = (pose * 0.6180339887) % 1.0  # golden ratio: neighbouring poses see other azimuths
    azimuths = (np.arange(VIEWS) + turn) * (2 * np.pi / VIEWS)
    order = np.random.default_rng(pose).permutation(VIEWS)
    return np.stack([azimuths, _ELEVATIONS[order]], axis=1)


def render_views(body: Body, rotations: NDArray[np.float64], first: int) -> PoseViews:
    """Render and describe all views of consecutive poses.

    Parameters
    ----------
    body : Body
    rotations : (N, 21, 3, 3)
        Segment rotations, model frame.
    first : int
        Number of the first pose in the bank, which fixes its viewing directions.

    Returns
    -------
    PoseViews
    """
    import open3d as o3d

    n = len(rotations)
    descriptors = np.empty((n, VIEWS, describe_size()), np.float16)
    frames = np.empty((n, VIEWS, 3, 3), np.float32)
    origins = np.empty((n, VIEWS, 3), np.float32)
    faces = body.faces.astype(np.uint32)
    for k in range(n):
        vertices = body.pose(rotations[k], np.zeros(3)).vertices
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(vertices.astype(np.float32), faces)
        for v, (azimuth, elevation) in enumerate(view_directions(first + k)):
            rotation, target = view_rotation(azimuth, elevation), vertices.mean(axis=0)
            points = cast_view(scene, vertices, rotation, target)
            axes = canonical_axes(points)[0]
            descriptors[k, v] = describe(points, axes)
            # x_camera = rotation (x_model - target) + (0, 0, DISTANCE)
            frames[k, v] = axes.rotation @ rotation
            origins[k, v] = rotation.T @ (axes.origin - [0.0, 0.0, DISTANCE_M]) + target
    return PoseViews(descriptors, frames, origins)


def describe_size() -> int:
    """Length of a descriptor."""
    from depth_pose.bank.canonical import DESCRIPTOR_SIZE

    return DESCRIPTOR_SIZE * DESCRIPTOR_SIZE


def cast_view(
    scene: object,
    vertices: NDArray[np.float64],
    rotation: NDArray[np.float64],
    target: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Cast rays at a scene from one direction.

    Returns
    -------
    (P, 3) float64
        The points hit, in the camera frame, metres.
    """
    seen = (vertices - target) @ rotation.T
    plane = seen[:, :2] / (seen[:, 2:] + DISTANCE_M)
    low, high = plane.min(axis=0), plane.max(axis=0)
    x, y = np.meshgrid(
        np.arange(low[0], high[0] + _RAY_SPACING, _RAY_SPACING),
        np.arange(low[1], high[1] + _RAY_SPACING, _RAY_SPACING),
    )
    directions = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    rays = np.empty((len(directions), 6), np.float32)
    rays[:, :3] = target - DISTANCE_M * rotation[2]
    rays[:, 3:] = directions @ rotation
    hit = scene.cast_rays(rays, nthreads=1)["t_hit"].numpy()  # type: ignore[attr-defined]
    found = np.isfinite(hit)
    return directions[found] * hit[found, None].astype(np.float64)
