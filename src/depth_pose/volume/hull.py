"""Shape from silhouette: calibrated silhouettes to the surface voxels of the visual hull.

Two levels: blocks of about 8 cm are kept or discarded as a whole with integral images (a block
that falls on background only in one camera is empty, one that falls on silhouette only in all of
them is full), and only the rest is carved voxel by voxel. The pixel of every voxel in every camera
is computed once per set of cameras.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.rooms.rig import RigCamera, check_images
from depth_pose.volume import _hull_kernels as kernels
from depth_pose.volume.config import SpaceConfig

_BLOCK_M = 0.08
"""Edge of a block, metres."""
_MOST_TABLE_BYTES = 3_000_000_000
"""Maximum size of the tables of projections: larger ones would not fit in a small machine's memory."""
_FIRST_CAPACITY = 30_000
"""Initial capacity of surface voxels; ten times a person's at 2 cm."""
LEAST_VIEWS = 2
"""Minimum number of cameras that see a voxel: one silhouette alone is a cone, not a body."""


@dataclass(frozen=True)
class Volume:
    """A person's volume in one frame.

    Attributes
    ----------
    surface : (N, 3) float64
        Centres of the surface voxels, world frame, metres.
    centroid : (3,) float64
        Mean of all voxels (of the surface ones where the inside is not known), metres.
    voxels : int
        Number of voxels, surface and inside.
    views : int
        Number of cameras used.
    eyes : (n, 3) float64
        Positions of the depth cameras, which see only the sides facing them, metres; none for whole volumes.
    parts : tuple of Volume
        The volume seen by each of several depth cameras, in the order of `eyes`; empty otherwise.
    """

    surface: NDArray[np.float64]
    centroid: NDArray[np.float64]
    voxels: int
    views: int
    eyes: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    parts: tuple[Volume, ...] = ()

    @property
    def sights(self) -> tuple[Volume, ...]:
        """Volumes with descriptors of their own: those of each depth camera, or the whole volume."""
        return self.parts or (self,)

    @property
    def seen_from(self) -> float:
        """Azimuth of the one depth camera from the person, atan2(x, z), radians; 0 for whole volumes."""
        if len(self.eyes) != 1:
            return 0.0
        x, _, z = self.eyes[0] - self.centroid
        return float(np.arctan2(x, z))

    @property
    def is_empty(self) -> bool:
        """Whether there is no person."""
        return len(self.surface) == 0


def empty_volume(views: int) -> Volume:
    """Return the volume of an empty space."""
    return Volume(np.zeros((0, 3)), np.zeros(3), 0, views)


class HullCarver:
    """Carves one space with one set of cameras.

    Parameters
    ----------
    cameras : sequence of RigCamera
        At least `LEAST_VIEWS`.
    space : SpaceConfig
    """

    def __init__(self, cameras: Sequence[RigCamera], space: SpaceConfig | None = None) -> None:
        space = space or SpaceConfig()
        if len(cameras) < LEAST_VIEWS:
            raise ConfigError(f"a hull needs at least {LEAST_VIEWS} cameras, not {len(cameras)}")
        self.cameras, self.space = tuple(cameras), space
        side = max(2, round(_BLOCK_M / space.voxel))
        block = side * space.voxel
        across = max(1, int(np.ceil(2 * space.half_width / block - 1e-6)))
        up = max(1, int(np.ceil(space.height / block - 1e-6)))
        edge = across * block / 2
        origin = np.array([space.centre_x - edge, 0.0, space.centre_z - edge])
        self._grid = kernels.Grid(origin, space.voxel, (across, up, across), side)
        blocks, n = across * up * across, side**3
        size = 4 * blocks * len(cameras) * n
        if size > _MOST_TABLE_BYTES:
            raise ConfigError(
                f"voxels of {space.voxel * 100:g} cm in this space need tables of {size / 1e9:.1f} GB; "
                "make voxel larger, or half_width or height smaller"
            )
        self._tables = np.empty((blocks, len(cameras), n), np.int32)
        self._rects = np.empty((blocks, len(cameras), 4), np.int32)
        for i, c in enumerate(cameras):
            kernels.project_voxels(self._grid, c.T_camera_world, c.camera, i, self._tables, self._rects)
        sizes = np.array([(c.camera.height, c.camera.width) for c in cameras])
        height, width = sizes.max(axis=0)
        self._flat = np.zeros((len(cameras), int((sizes[:, 0] * sizes[:, 1]).max())), np.uint8)
        self._sums = np.zeros((len(cameras), height + 1, width + 1), np.int32)
        self._blocks, self._marks = np.zeros(blocks, np.uint8), np.zeros((blocks, n), np.uint8)
        self._stack, self._labels = np.empty(blocks, np.int64), np.zeros(blocks, np.int32)
        self._points = np.empty((_FIRST_CAPACITY, 3))

    def carve(self, silhouettes: Sequence[NDArray[np.generic] | None]) -> Volume:
        """Find the person's volume; the largest connected one where there are several.

        Parameters
        ----------
        silhouettes : sequence of (H, W) arrays or None
            One per camera, in their order, nonzero on the person. None without an image: the camera is then
            ignored. An empty silhouette means that there is nobody.

        Raises
        ------
        InputError
            Where an image is missing from the list or of another size than its camera's.
        """
        check_images(silhouettes, self.cameras)
        present = np.array([s is not None for s in silhouettes])
        for c, (silhouette, rig) in enumerate(zip(silhouettes, self.cameras, strict=True)):
            if silhouette is None:
                continue
            mask = np.ascontiguousarray(silhouette).reshape(-1) != 0
            self._flat[c, : mask.size] = mask
            kernels.integrate(
                self._flat[c, : mask.size].reshape(silhouette.shape),
                self._sums[c, : rig.camera.height + 1, : rig.camera.width + 1],
            )
        views = int(present.sum())
        if views < LEAST_VIEWS:
            return empty_volume(views)
        kernels.carve(
            self._tables, self._rects, self._flat, self._sums, present, LEAST_VIEWS, self._blocks, self._marks
        )
        kernels.keep_largest(self._grid, self._blocks, self._marks, self._stack, self._labels)
        centroid = np.zeros(3)
        count, total = self._surface(centroid)
        if count > len(self._points):
            self._points = np.empty((count * 5 // 4, 3))
            self._surface(centroid)
        return Volume(self._points[:count].copy(), centroid, total, views)

    def _surface(self, centroid: NDArray[np.float64]) -> tuple[int, int]:
        found: tuple[int, int] = kernels.find_surface(
            self._grid, self._blocks, self._marks, self._points, centroid
        )
        return found


class SurfaceVoxels:
    """Collects points of depth cameras in the voxels of the space."""

    def __init__(self, space: SpaceConfig | None = None) -> None:
        self.space = space or SpaceConfig()
        across = int(np.ceil(2 * self.space.half_width / self.space.voxel))
        self._shape = (across, int(np.ceil(self.space.height / self.space.voxel)), across)
        edge = across * self.space.voxel / 2
        self._origin = np.array([self.space.centre_x - edge, 0.0, self.space.centre_z - edge])
        self._seen = np.zeros(int(np.prod(self._shape)), np.uint8)

    def see(self, points_world: NDArray[np.float64], eye: NDArray[np.float64]) -> Volume:
        """Return the surface voxels of the points (N, 3) seen by a camera at (3,), metres."""
        surface = self._voxels_of(points_world)
        if len(surface) == 0:
            return empty_volume(1)
        return Volume(surface, surface.mean(axis=0), len(surface), 1, np.array(eye, np.float64)[None])

    def join(self, parts: Sequence[Volume]) -> Volume:
        """Combine the surfaces of several cameras into one."""
        parts = [p for p in parts if not p.is_empty]
        if len(parts) < 2:
            return parts[0] if parts else empty_volume(0)
        surface = self._voxels_of(np.concatenate([p.surface for p in parts]))
        eyes = np.concatenate([p.eyes for p in parts])
        return Volume(surface, surface.mean(axis=0), len(surface), len(parts), eyes, tuple(parts))

    def _voxels_of(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Centres of the voxels that hold points, each once."""
        found = np.empty(len(points), np.int64)
        surface: NDArray[np.float64] = kernels.mark_points(
            points, self._origin, self.space.voxel, self._shape, self._seen, found
        )
        return surface
