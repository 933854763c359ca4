"""The empty room as one camera sees it: the median of depth images over time, its points and normals."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from depth_pose.core.camera import Camera
from depth_pose.core.types import HIDDEN, DepthFrame
from depth_pose.track.person import People

Array = NDArray[np.float64]

_MOST_PX = 640
"""Images wider than this are thinned to every second pixel and so on. Set by hand."""
_MOST_IMAGES = 60
"""Number of images above which every second one is dropped. Set by hand."""
_MARGIN = 0.012
"""Margin around people, as a share of the image's width. Set by hand."""
_QUANTILE = 0.65
"""Quantile over time of a pixel's depth: people who are not found stand before the room, so more than the
median. Set by hand."""
_LEAST_SHARE = 0.15
"""Share of images in which a pixel of the empty room has a return, and nobody covers it. Set by hand."""
_SPREAD_M, _SPREAD = 0.02, 0.02
"""Depths within this (m, and share of the depth) of the quantile are averaged. Set by hand."""
_VOXEL_M = 0.05
"""Points are thinned to one a cube of this side, metres. Set by hand."""
_JUMP = 0.04
"""Pixels whose neighbours differ by more than this share of the depth are edges. Set by hand."""
_NEIGHBOURS, _REACH_M = 16, 0.2
"""Neighbours from which a normal is computed, and their farthest distance, metres. Set by hand."""
_LEAST_NEIGHBOURS = 6
"""Fewest neighbours of a point with a normal. Set by hand."""
_FLAT = 0.02
"""Largest thickness of a flat neighbourhood: deviation along the normal, metres. Set by hand."""


@dataclass
class BackgroundBuilder:
    """Collects depth images of one camera and computes that of the empty room."""

    _images: list[NDArray[np.float32]] = field(default_factory=list)
    camera: Camera | None = None
    _count: int = -1
    _every: int = 1

    def add(self, frame: DepthFrame, people: People) -> None:
        """Add an image without the people in it; all have one camera, others are ignored."""
        step = -(-frame.camera.width // _MOST_PX)
        camera = frame.camera.strided(step)
        if self.camera is None:
            self.camera = camera
        self._count += 1
        if camera == self.camera and self._count % self._every == 0:
            depth = np.nan_to_num(frame.depth[::step, ::step])
            self._images.append(np.where(_covered(people, camera), np.float32(0.0), depth))
        if len(self._images) > _MOST_IMAGES:
            self._images, self._every = self._images[::2], 2 * self._every

    def image(self) -> NDArray[np.float32] | None:
        """Return the depth image of the empty room, metres, 0 where unknown; None without images."""
        return empty_room(np.stack(self._images)) if self._images else None


def _covered(people: People, camera: Camera) -> NDArray[np.bool_]:
    """Return the pixels (H, W) of a camera's image that people cover, with a margin."""
    own = people.camera
    covered = (people.labels > 0) & (people.labels < HIDDEN)
    covered = maximum_filter(covered, size=1 + 2 * round(_MARGIN * own.width))
    column = np.rint((np.arange(camera.width) - camera.cx) * own.fx / camera.fx + own.cx).astype(np.int64)
    row = np.rint((np.arange(camera.height) - camera.cy) * own.fy / camera.fy + own.cy).astype(np.int64)
    return np.asarray(covered[np.clip(row, 0, own.height - 1)][:, np.clip(column, 0, own.width - 1)])


def empty_room(images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Compute the depth image of the empty room from images (T, H, W) over time, metres; 0: no return.

    Depths near a pixel's quantile are averaged, which also evens out a sensor's steps.
    """
    count = (images > 0).sum(axis=0)
    ordered = np.sort(np.where(images > 0, images, np.float32(np.inf)), axis=0)
    rank = np.clip((_QUANTILE * count).astype(np.int64), 0, np.maximum(count - 1, 0))
    middle = np.take_along_axis(ordered, rank[None], axis=0)[0]
    known = (count > 0) & (count >= _LEAST_SHARE * len(images))
    middle = np.where(known, middle, np.float32(0.0))
    near = (images > 0) & (np.abs(images - middle) < _SPREAD_M + _SPREAD * middle)
    mean = (images * near).sum(axis=0) / np.maximum(near.sum(axis=0), 1)
    return np.where(known, mean, 0.0).astype(np.float32)


@dataclass(frozen=True)
class RoomSurface:
    """Flat places of the empty room as one camera sees it, camera frame.

    Attributes
    ----------
    points, normals : (N, 3) float64
        Metres; the normals look to the camera.
    """

    points: Array
    normals: Array


def find_surface(depth: NDArray[np.float32], camera: Camera) -> RoomSurface:
    """Compute thinned points and normals of a depth image (H, W), metres; 0 where nothing returned."""
    seen = camera.back_project(np.where(_is_smooth(depth), depth, np.float32(0.0)))
    points = thin_to_voxels(seen[np.isfinite(seen).all(axis=-1)].astype(np.float64), _VOXEL_M)
    if len(points) <= _NEIGHBOURS:
        return RoomSurface(np.zeros((0, 3)), np.zeros((0, 3)))
    distance, index = cKDTree(points).query(points, _NEIGHBOURS, distance_upper_bound=_REACH_M)
    near = np.isfinite(distance)
    count = near.sum(axis=1)
    around = points[np.where(near, index, 0)] - points[:, None]
    mean = (around * near[..., None]).sum(axis=1) / count[:, None]
    around = (around - mean[:, None]) * near[..., None]
    spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around) / count[:, None, None])
    normals = axes[..., 0]
    normals = np.where(np.sum(normals * points, axis=1, keepdims=True) > 0, -normals, normals)
    flat = (count >= _LEAST_NEIGHBOURS) & (np.sqrt(np.maximum(spread[:, 0], 0.0)) < _FLAT)
    return RoomSurface(points[flat], normals[flat])


def _is_smooth(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether a pixel has a return, and no neighbour (of four) is much nearer or farther."""
    smooth = depth > 0
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis))
        least = np.minimum(np.delete(depth, -1, axis), np.delete(depth, 0, axis))
        jump = (step > _JUMP * least) & (least > 0)
        pad = [(0, 0), (0, 0)]
        pad[axis] = (1, 0)
        smooth &= ~np.pad(jump, pad)
        pad[axis] = (0, 1)
        smooth &= ~np.pad(jump, pad)
    return smooth


def thin_to_voxels(points: Array, side_m: float) -> Array:
    """Return the mean of the points (N, 3) in each cube of a grid, in a fixed order."""
    if not len(points):
        return points
    cells = np.floor(points / side_m).astype(np.int64)
    _, where, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    where = where.ravel()
    total = np.stack([np.bincount(where, points[:, k], len(count)) for k in range(3)], axis=1)
    return np.asarray(total / count[:, None])
