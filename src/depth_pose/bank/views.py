"""Views of posed bodies in canonical axes: Open3D ray casting (Sec. 5.1).

Two schemes. ``partial``: the body is seen from all around and from below to above, and each
partial cloud is put into canonical axes exactly as an input is. ``paper``: the axes are the
principal ones of the *whole* mesh, and a virtual camera looks along the third of them. The paper
alternates the signs of the second and third axis, four frames; two of them are proper rotations,
which are what a bank holds, and two are mirror images, which `render_views` gives for comparison.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.bank import _ray_kernels as kernels
from depth_pose.bank.canonical import DESCRIPTOR_SIZE, CanonicalAxes, canonical_axes, describe
from depth_pose.body.body import Body
from depth_pose.core.open3d import load_open3d
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL

Array = NDArray[np.float64]

DISTANCE_M = 3.0
"""From the virtual camera to the middle of the body."""

VIEWS = 16
"""Partial views of each pose, one for every sixteenth of a turn.

With half as many, the nearest view is up to 22 degrees off, which costs more than half of the
poses do: a wrong pose seen from the right side then looks better than the right one.
"""

_RAY_SPACING = 0.028 / DISTANCE_M
"""Tangent of the angle between neighbouring rays."""

_ELEVATIONS = np.radians([0, 8, 20, -10, 12, 4, 32, 50, 0, 8, 20, -15, 12, 32, 45, 60])
"""Elevations of the views, each used once per pose: most sensors stand at chest height and look level."""

_CAMERA_AXES = R_CAMERA_FACING_MODEL.copy()
"""Right, up and toward the camera, in the camera frame: the axes of somebody who faces it.

A copy, because kernels are compiled once more for an array that cannot be written.
"""


@dataclass(frozen=True)
class PoseViews:
    """Views of some poses.

    Attributes
    ----------
    descriptors : (N, W, 2304) float16
    rotations : (N, W, 3, 3) float32
        ``R_canonical_model``; its determinant is -1 for a mirror image.
    origins : (N, W, 3) float32
        Origin of the canonical axes in the model frame, pelvis at the origin, metres.
    """

    descriptors: NDArray[np.float16]
    rotations: NDArray[np.float32]
    origins: NDArray[np.float32]


@dataclass(frozen=True)
class View:
    """A virtual camera, ``DISTANCE_M`` from a target in the model frame.

    Attributes
    ----------
    rotation : (3, 3) float64
        ``R_camera_model``; its determinant is -1 for a mirror image.
    target : (3,) float64
        Metres.
    own_axes : bool
        Whether the view's cloud has canonical axes of its own; otherwise they are the camera's.
    """

    rotation: Array
    target: Array
    own_axes: bool


def view_rotation(azimuth: float, elevation: float) -> Array:
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


def view_directions(pose: int) -> Array:
    """Azimuth and elevation of every partial view of a pose, (16, 2), radians; fixed by its number."""
    turn = (pose * 0.6180339887) % 1.0  # golden ratio: neighbouring poses see other azimuths
    azimuths = (np.arange(VIEWS) + turn) * (2 * np.pi / VIEWS)
    order = np.random.default_rng(pose).permutation(VIEWS)
    return np.stack([azimuths, _ELEVATIONS[order]], axis=1)


def partial_views(vertices: Array, pose: int) -> list[View]:
    """Return the cameras all around a posed body."""
    middle = vertices.mean(axis=0)
    return [View(view_rotation(a, e), middle, True) for a, e in view_directions(pose)]


def paper_views(vertices: Array, pose: int, mirrored: bool = False) -> list[View]:
    """Return the cameras that look along the third principal axis of the whole mesh (Sec. 5.1).

    Parameters
    ----------
    vertices : (V, 3)
        Posed body, model frame, metres.
    pose : int
        Not used: the frames do not depend on the pose's number.
    mirrored : bool
        As printed: all four signs of the second and third axis, of which two are mirror images.
    """
    middle = vertices.mean(axis=0)
    up, second = principal_directions(vertices - middle, np.array([0.0, 1.0, 0.0]))
    third = np.cross(second, up)
    signs = ((1, 1), (-1, -1), (1, -1), (-1, 1)) if mirrored else ((1, 1), (-1, -1))
    return [View(_CAMERA_AXES @ np.stack([a * second, up, b * third]), middle, False) for a, b in signs]


def paper_mirrored_views(vertices: Array, pose: int) -> list[View]:
    """Return `paper_views` as printed, mirror images included."""
    return paper_views(vertices, pose, mirrored=True)


def principal_directions(centred: Array, camera_up: Array) -> tuple[Array, Array]:
    """Return the largest principal axis, turned up, and the second one with arbitrary sign."""
    vectors = np.linalg.eigh(centred.T @ centred)[1]
    up = vectors[:, 2] if vectors[:, 2] @ camera_up >= 0 else -vectors[:, 2]
    return up, vectors[:, 1]


def paper_axes(points: Array) -> tuple[CanonicalAxes, ...]:
    """Canonical axes of an input by the paper's rule: principal axes, the second's sign arbitrary.

    Parameters
    ----------
    points : (N, 3) float64
        Camera frame, metres.
    """
    origin = points.mean(axis=0)
    up, second = principal_directions(points - origin, np.array([0.0, -1.0, 0.0]))
    return (CanonicalAxes(np.stack([second, up, np.cross(second, up)]), origin),)


SCHEMES = {"partial": partial_views, "paper": paper_views, "paper-mirrored": paper_mirrored_views}
"""Cameras of a posed body by the scheme's name."""

AXES = {"partial": canonical_axes, "paper": paper_axes, "paper-mirrored": paper_axes}
"""Canonical axes of an input by the scheme of the bank that it is matched with."""


def render_views(
    body: Body, rotations: NDArray[np.float64], first: int, scheme: str = "partial"
) -> PoseViews:
    """Render and describe all views of consecutive poses.

    Parameters
    ----------
    body : Body
    rotations : (N, 21, 3, 3)
        Segment rotations, model frame.
    first : int
        Number of the first pose in the bank, which fixes its viewing directions.
    scheme : str
        One of `SCHEMES`.

    Returns
    -------
    PoseViews
    """
    descriptors, frames, origins = [], [], []
    middle = np.array([0.0, 0.0, DISTANCE_M])
    for k in range(len(rotations)):
        vertices = body.pose(rotations[k], np.zeros(3)).vertices
        views = SCHEMES[scheme](vertices, first + k)
        clouds = cast_views(make_scene(vertices, body.faces), vertices, views)
        for view, points in zip(views, clouds, strict=True):
            axes = canonical_axes(points)[0] if view.own_axes else CanonicalAxes(_CAMERA_AXES, middle)
            descriptors.append(describe(points, axes).astype(np.float16))
            # x_camera = rotation (x_model - target) + (0, 0, DISTANCE)
            frames.append((axes.rotation @ view.rotation).astype(np.float32))
            origins.append((view.rotation.T @ (axes.origin - middle) + view.target).astype(np.float32))
    n = len(rotations)
    return PoseViews(
        np.stack(descriptors).reshape(n, -1, DESCRIPTOR_SIZE * DESCRIPTOR_SIZE),
        np.stack(frames).reshape(n, -1, 3, 3),
        np.stack(origins).reshape(n, -1, 3),
    )


def make_scene(vertices: Array, faces: NDArray[np.int32]) -> Any:
    """Build an Open3D ray-casting scene of a mesh, with one thread."""
    open3d = load_open3d()

    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    return scene


def cast_views(scene: Any, vertices: Array, views: list[View]) -> Iterator[Array]:
    """Cast rays at a mesh from every view, all of them at once.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        Holds the mesh.
    vertices : (V, 3) float64
        The mesh's vertices, model frame, metres; the rays cover these.
    views : list of View

    Yields
    ------
    (P, 3) float64
        The points hit, in the view's camera frame, metres.
    """
    grids = [kernels.grid_around(vertices, v.rotation, v.target, DISTANCE_M, _RAY_SPACING) for v in views]
    ends = np.cumsum([columns * rows for _, _, columns, rows in grids]).tolist()
    rays = np.empty((ends[-1], 6), np.float32)
    for view, grid, end in zip(views, grids, ends, strict=True):
        low_x, low_y, columns, rows = grid
        eye = view.target - DISTANCE_M * view.rotation[2]
        part = rays[end - columns * rows : end]
        kernels.aim_rays(low_x, low_y, columns, rows, _RAY_SPACING, view.rotation, eye, part)
    depth = scene.cast_rays(rays, nthreads=1)["t_hit"].numpy()
    for grid, end in zip(grids, ends, strict=True):
        low_x, low_y, columns, rows = grid
        part = depth[end - columns * rows : end]
        yield kernels.gather_hits(low_x, low_y, columns, rows, _RAY_SPACING, part)
