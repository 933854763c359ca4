"""Cameras in the scene, drawn as frusta."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.rotations import matrix_to_quat
from depth_pose.rooms.rig import RigCamera

_SCALE_M = 0.25
"""Size of a frustum, metres; for readability."""
_COLOUR = (240, 170, 60)


def add_frustum(server: Any, path: str, camera: Camera) -> Any:
    """Add the frustum of a camera, in the optical frame of its parent in the scene."""
    fov = 2 * np.arctan2(camera.height / 2, camera.fy)
    return server.scene.add_camera_frustum(
        path, float(fov), camera.width / camera.height, scale=_SCALE_M, color=_COLOUR
    )


def pose_node(node: Any, T_parent_node: NDArray[np.float64]) -> None:
    """Set the pose of a node of the scene in its parent."""
    x, y, z, w = matrix_to_quat(T_parent_node[:3, :3]).tolist()
    node.wxyz, node.position = (w, x, y, z), tuple(T_parent_node[:3, 3].tolist())


class RoomCameras:
    """The cameras of a room, with their names.

    Parameters
    ----------
    server : viser.ViserServer
    cameras : sequence of RigCamera
    """

    def __init__(self, server: Any, cameras: Sequence[RigCamera]) -> None:
        self._shown = []
        for number, camera in enumerate(cameras):
            frustum = add_frustum(server, f"/cameras/{number}", camera.camera)
            pose_node(frustum, camera.T_room_camera)
            self._shown += [frustum, server.scene.add_label(f"/cameras/{number}/name", camera.name)]

    def show(self, wanted: bool) -> None:
        """Show or hide them."""
        for handle in self._shown:
            handle.visible = wanted
