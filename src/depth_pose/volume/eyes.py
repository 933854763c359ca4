"""Convert the images of a rig at one time: silhouettes to a hull, or depth to surfaces.

People are cut out of depth images by the first stage of the main method (`depth_pose.perception`), live
and offline alike, unless ``views.cut_out`` is off.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.errors import ConfigError
from depth_pose.core.frame import DepthFrame
from depth_pose.perception import Perception
from depth_pose.rooms.rig import RigCamera, check_images
from depth_pose.volume.config import SpaceConfig, VolumeConfig
from depth_pose.volume.hull import LEAST_VIEWS, HullCarver, SurfaceVoxels, Volume
from depth_pose.volume.synchroniser import ViewSet

_SLIVER = 0.3
"""Minimum surface seen by a depth camera, as a share of the largest one's; below it, the camera is ignored.
Set by hand."""


class HullEyes:
    """Silhouettes: the visual hull.

    An empty silhouette would empty the whole space; if most of the others show a person, it counts as
    a failure and is ignored.
    """

    def __init__(self, cameras: Sequence[RigCamera], space: SpaceConfig) -> None:
        self.carver = HullCarver(cameras, space)

    def see(self, views: ViewSet) -> tuple[Volume, tuple[int, ...]]:
        """Carve the hull."""
        empty = tuple(i for i, s in enumerate(views.images) if s is not None and not s.any())
        showing = sum(s is not None for s in views.images) - len(empty)
        wrong = empty if showing >= max(LEAST_VIEWS, 2 * len(empty)) else ()
        return self.carver.carve([None if i in wrong else s for i, s in enumerate(views.images)]), wrong

    def reset(self) -> None:
        """Do nothing: there is no state."""

    def warm_up(self) -> None:
        """Compile every kernel."""
        shapes = [(c.camera.height, c.camera.width) for c in self.carver.cameras]
        self.carver.carve([np.zeros(shape, np.uint8) for shape in shapes])


class DepthEyes:
    """Depth: the person's points in each image, and the surface voxels that they lie in.

    A camera that sees much less of the person than another one is occluded or has failed, and is
    ignored.
    """

    def __init__(self, cameras: Sequence[RigCamera], config: VolumeConfig) -> None:
        if not cameras:
            raise ConfigError("a model of depth needs at least one camera")
        self.cameras, self._voxels = tuple(cameras), SurfaceVoxels(config.space)
        self._perceptions = (
            [Perception(config.segment, config.denoise) for _ in cameras] if config.views.cut_out else []
        )

    def see(self, views: ViewSet) -> tuple[Volume, tuple[int, ...]]:
        """Find the person's surfaces and combine them."""
        check_images(views.images, self.cameras)
        seen = {
            i: self._voxels.see(self._points(i, depth, views.stamp_ns), self.cameras[i].position)
            for i, depth in enumerate(views.images)
            if depth is not None
        }
        most = max((v.voxels for v in seen.values()), default=0)
        wrong = tuple(i for i, v in seen.items() if v.voxels < _SLIVER * most)
        return self._voxels.join([v for i, v in seen.items() if i not in wrong]), wrong

    def _points(self, index: int, depth: NDArray[np.float32], stamp_ns: int) -> NDArray[np.float64]:
        """Find the points (N, 3), world frame, of the most visible person in one camera's image."""
        rig = self.cameras[index]
        if not self._perceptions:
            return rig.points_world(depth)
        people = self._perceptions[index].perceive(DepthFrame(stamp_ns, rig.name, depth, rig.camera))
        most = max((p.points for p in people.persons), key=len, default=np.zeros((0, 3)))
        return rig.to_world(most)

    def reset(self) -> None:
        """Forget the person in each camera's images."""
        for perception in self._perceptions:
            perception.reset()

    def warm_up(self) -> None:
        """Compile every kernel."""
        for perception in self._perceptions[:1]:
            perception.warm_up()
        blank = self.cameras[0].camera
        self._voxels.see(self.cameras[0].points_world(np.ones((blank.height, blank.width))), np.zeros(3))


def make_eyes(kind: str, cameras: Sequence[RigCamera], config: VolumeConfig) -> HullEyes | DepthEyes:
    """Build the eyes for ``silhouettes`` or for ``depth``."""
    return DepthEyes(cameras, config) if kind == "depth" else HullEyes(cameras, config.space)
