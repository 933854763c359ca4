"""The empty room as one camera sees it: the median of depth images over time, its points and normals."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from depth_pose.core.camera import Camera
from depth_pose.core.frame import DepthFrame
from depth_pose.core.labels import HIDDEN
from depth_pose.track.person_view import FramePeople

Array = NDArray[np.float64]

_MOST_PX = 640
"""Maximum image width (pixels); wider images are subsampled by 2, 3, ... Set by hand."""
_MOST_IMAGES = 60
"""Number of images above which every second one is dropped. Set by hand."""
_MARGIN = 0.012
"""Margin around people, as a share of the image's width. Set by hand."""
_LEAST_SHARE = 0.15
"""Minimum share of images in which a pixel of the empty room has a return and is not covered by a person. Set
by hand."""
_NEAR_M, _NEAR = 0.02, 0.02
"""Depths within this (m, and share of the depth) of the median are averaged. Set by hand."""
_VOXEL_M = 0.05
"""Edge of the cubes in which points are averaged to one (m). Set by hand."""
_JUMP = 0.04
"""Pixels whose neighbours differ by more than this share of the depth are edges. Set by hand."""
_NEIGHBOURS, _REACH_M = 16, 0.2
"""Number of neighbours that a normal is computed from, and their maximum distance (m). Set by hand."""
_LEAST_NEIGHBOURS = 6
"""Minimum number of neighbours for a normal. Set by hand."""
_FLAT_M = 0.02
"""Maximum deviation along the normal in a flat neighbourhood (m). Set by hand."""


@dataclass(frozen=True)
class EmptyRoom:
    """The empty room as one camera sees it.

    Attributes
    ----------
    depth : (H, W) float32
        Metres; 0 where it is not known.
    spread : (H, W) float32
        Deviation of the depth over time, metres.
    camera : Camera
    """

    depth: NDArray[np.float32]
    spread: NDArray[np.float32]
    camera: Camera


@dataclass
class BackgroundBuilder:
    """Collects depth images of one camera and computes that of the empty room."""

    _images: list[NDArray[np.float32]] = field(default_factory=list)
    camera: Camera | None = None
    _count: int = -1
    _every: int = 1

    def add(self, frame: DepthFrame, people: FramePeople) -> None:
        """Add an image without its people; images of another camera than the first one's are ignored."""
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

    def room(self) -> EmptyRoom | None:
        """Return the empty room; None without images."""
        if self.camera is None or not self._images:
            return None
        return empty_room(np.stack(self._images), self.camera)


def _covered(people: FramePeople, camera: Camera) -> NDArray[np.bool_]:
    """Return the pixels (H, W) of a camera's image that people cover, with a margin."""
    own = people.camera
    covered = (people.labels > 0) & (people.labels < HIDDEN)
    covered = maximum_filter(covered, size=1 + 2 * round(_MARGIN * own.width))
    column = np.rint((np.arange(camera.width) - camera.cx) * own.fx / camera.fx + own.cx).astype(np.int64)
    row = np.rint((np.arange(camera.height) - camera.cy) * own.fy / camera.fy + own.cy).astype(np.int64)
    return np.asarray(covered[np.clip(row, 0, own.height - 1)][:, np.clip(column, 0, own.width - 1)])


def empty_room(images: NDArray[np.float32], camera: Camera) -> EmptyRoom:
    """Compute the empty room from depth images (T, H, W) over time, metres; 0: no return.

    Depths near a pixel's median are averaged, which also smooths a sensor's quantisation.
    """
    middle = _median(images)
    known = (images > 0).sum(axis=0) >= np.maximum(1.0, _LEAST_SHARE * len(images))
    off = np.where(images > 0, np.abs(images - middle), np.float32(0.0))
    spread = 1.48 * _median(np.maximum(off, np.float32(1e-6)) * (images > 0))
    near = (images > 0) & (off < _NEAR_M + _NEAR * middle)
    mean = (images * near).sum(axis=0) / np.maximum(near.sum(axis=0), 1)
    return EmptyRoom(np.where(known, mean, 0.0).astype(np.float32), spread.astype(np.float32), camera)


def _median(images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the median over time of the values above 0; 0 where there are none."""
    count = (images > 0).sum(axis=0)
    ordered = np.sort(np.where(images > 0, images, np.float32(np.inf)), axis=0)
    found = np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    return np.where(count > 0, found, np.float32(0.0))


@dataclass(frozen=True)
class RoomSurface:
    """Flat places of the empty room as one camera sees it, camera frame.

    Attributes
    ----------
    points, normals : (N, 3) float64
        Metres; the normals point to the camera.
    spread : (N,) float64
        Deviation of their depth over time, metres.
    """

    points: Array
    normals: Array
    spread: Array


def find_surface(room: EmptyRoom) -> RoomSurface:
    """Compute thinned points and normals of the empty room."""
    seen = room.camera.back_project(np.where(_is_smooth(room.depth), room.depth, np.float32(0.0)))
    there = np.isfinite(seen).all(axis=-1)
    rows = np.column_stack([seen[there], room.spread[there]]).astype(np.float64)
    rows = thin_to_voxels(rows, _VOXEL_M)
    points, over_time = rows[:, :3], rows[:, 3]
    if len(points) <= _NEIGHBOURS:
        return RoomSurface(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    distance, index = cKDTree(points).query(points, _NEIGHBOURS, distance_upper_bound=_REACH_M)
    near = np.isfinite(distance)
    count = near.sum(axis=1)
    around = points[np.where(near, index, 0)] - points[:, None]
    mean = (around * near[..., None]).sum(axis=1) / count[:, None]
    around = (around - mean[:, None]) * near[..., None]
    spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around) / count[:, None, None])
    normals = axes[..., 0]
    normals = np.where(np.sum(normals * points, axis=1, keepdims=True) > 0, -normals, normals)
    flat = (count >= _LEAST_NEIGHBOURS) & (np.sqrt(np.maximum(spread[:, 0], 0.0)) < _FLAT_M)
    return RoomSurface(points[flat], normals[flat], over_time[flat])


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
    """Return the mean of the rows (N, 3 or more) whose first three are in one cube of a grid."""
    if not len(points):
        return points
    cells = np.floor(points[:, :3] / side_m).astype(np.int64)
    _, where, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    where = where.ravel()
    total = np.stack([np.bincount(where, points[:, k], len(count)) for k in range(points.shape[1])], axis=1)
    return np.asarray(total / count[:, None])
