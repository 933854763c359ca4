"""Poses of the cameras in the room: from a rig file, or from the transforms on ``/tf_static``."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.printable import printable
from depth_pose.rooms.transform_tree import TransformTree
from depth_pose.ros.transport.host import TopicHost
from depth_pose.ros.transport.intake import LOG_EVERY_S
from depth_pose.ros.transport.rig_source import SENDERS, add_transforms
from depth_pose.ros.transport.tf import Transforms, stamped, tf_message

Array = NDArray[np.float64]

_SETTLE_S = 2.0
"""Seconds to wait for other publishers' transforms before a camera's is published."""


class RoomPoses:
    """Poses of the cameras' optical frames in the room's frame.

    Without a rig file they are read from ``/tf_static``. With one they are published there: the room becomes
    the parent of the optical frame or, if a driver has published a parent, of that tree's root. Nothing is
    published for frames that are connected to the room.

    Parameters
    ----------
    node : TopicHost
    room_frame : str
    T_room_camera : sequence of (4, 4) float64 or None
        By the rig file, one for each camera.
    """

    def __init__(self, node: TopicHost, room_frame: str, T_room_camera: Sequence[Array | None]) -> None:
        self._node, self._room = node, room_frame
        self._given = list(T_room_camera)
        self._tree = TransformTree()
        self._frames: dict[int, tuple[str, float]] = {}
        self._statics: Transforms | None = None
        if any(T is None for T in self._given) or importlib.util.find_spec("tf2_msgs") is not None:
            message = tf_message("the cameras' places (else give the parameter rig)")
            node.latch(message, "/tf_static", self._take_transforms, SENDERS)
            self._statics = Transforms(node, "the cameras' places", static=True)

    def find(self, camera: int, frame_id: str) -> Array | None:
        """Return the pose (4, 4) of a camera whose messages have the given frame; None if unknown."""
        if self._frames.get(camera, ("", 0.0))[0] != frame_id:
            self._frames[camera] = frame_id, time.monotonic()
        T = self._given[camera]
        return self._tree.find(self._room, frame_id) if T is None else T

    def missing(self) -> list[str]:
        """Return the frames of cameras without a connection to the room."""
        return [
            frame
            for camera, (frame, _) in sorted(self._frames.items())
            if self._given[camera] is None and self._tree.find(self._room, frame) is None
        ]

    def publish(self, stamp_ns: int) -> None:
        """Publish the poses of the rig file that nobody else has published; called periodically."""
        for camera, (frame, since_s) in self._frames.items():
            T_room_camera = self._given[camera]
            if self._statics is None or T_room_camera is None or time.monotonic() - since_s < _SETTLE_S:
                continue
            root, T_root_camera = self._tree.root_of(frame)
            if root is None or self._tree.find(self._room, frame) is not None:
                continue
            T_room_root = T_room_camera @ np.linalg.inv(T_root_camera)
            self._tree.add(self._room, root, T_room_root)
            self._statics.publish([stamped(stamp_ns, self._room, root, T_room_root)])

    def _take_transforms(self, message: Any) -> None:
        for error in add_transforms(self._tree, message.transforms):
            self._node.get_logger().error(
                f"/tf_static: {printable(error)}", throttle_duration_sec=LOG_EVERY_S
            )
