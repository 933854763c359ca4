"""Cameras of the volume node: a rig file, or CameraInfo with extrinsics or static transforms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo

from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.core.printable import printable
from depth_pose.io.calibration import camera_of_rectified
from depth_pose.rooms.rig import RigCamera
from depth_pose.rooms.rigfile import Rig, load_rig, upright_from
from depth_pose.rooms.transform_tree import TransformTree, pose_matrix
from depth_pose.ros.setting import Setting
from depth_pose.ros.transport.host import TopicHost
from depth_pose.ros.transport.intake import LOG_EVERY_S
from depth_pose.ros.transport.tf import tf_message

Array = NDArray[np.float64]

RIG_SETTINGS: tuple[Setting, ...] = (
    Setting("rig", "", "Rig file: topics, intrinsics and extrinsics of the cameras"),
    Setting("topics", [""], "Image topics, where there is no rig file"),
    Setting("info_topics", [""], "Their CameraInfo topics; empty: camera_info beside each image"),
    Setting("extrinsics", [0.0], "x y z qx qy qz qw of each optical frame in the world; else /tf_static"),
    Setting("world_frame", "map", "Frame of the skeletons, and of the static transforms"),
    Setting("up", "z", "Up axis of the world frame, z or y; a rig file has its own"),
)
"""Parameters for a node's cameras."""

SENDERS = 100
"""Number of senders of static transforms with a latched message."""


class RigSource:
    """Collects the cameras of a rig until all are known, then calls back once.

    Parameters
    ----------
    node : TopicHost
        With the parameters of `RIG_SETTINGS`.
    """

    def __init__(self, node: TopicHost) -> None:
        self._node = node
        self._done: Callable[[Rig], None] | None = None
        self.rig: Rig | None = None
        file = node.value("rig")
        if file:
            self.rig = load_rig(Path(file))
            self.topics: tuple[str, ...] = self.rig.topics
            return
        self.topics = tuple(t for t in node.value("topics") if t)
        if not self.topics:
            raise ConfigError("give the parameter rig (a rig file), or topics (a list of image topics)")
        self._up, self._world = str(node.value("up")), str(node.value("world_frame"))
        self._poses = given_extrinsics(node.value("extrinsics"), len(self.topics))
        self._infos: dict[int, CameraInfo] = {}
        self._tree = TransformTree()
        upright_from(self._up)

    def listen(self, done: Callable[[Rig], None]) -> None:
        """Subscribe to the unknown parts; ``done`` is called with the rig, at once if it is known."""
        if self.rig is not None:
            done(self.rig)
            return
        self._done = done
        named = [t for t in self._node.value("info_topics") if t]
        infos = named or [t.rpartition("/")[0] + "/camera_info" for t in self.topics]
        if len(infos) != len(self.topics):
            raise ConfigError(f"info_topics has {len(infos)} names; there are {len(self.topics)} topics")
        if self._poses is None:
            message = tf_message("the cameras' places (else give the parameter rig or extrinsics)")
            self._node.latch(message, "/tf_static", self._take_transforms, SENDERS)
        for i, topic in enumerate(infos):
            self._node.latch(CameraInfo, topic, partial(self._take_info, i))

    def missing(self) -> list[str]:
        """Return what is still unknown."""
        if self.rig is not None:
            return []
        out = [f"CameraInfo of {t}" for i, t in enumerate(self.topics) if i not in self._infos]
        if self._poses is None:
            frames = [m.header.frame_id for m in self._infos.values()]
            out += [f"transform from {self._world} to {f}" for f in frames if self._place(f) is None]
        return out

    def _take_info(self, index: int, info: CameraInfo) -> None:
        if self.rig is None:
            self._infos[index] = info
            self._try()

    def _take_transforms(self, message: Any) -> None:
        if self.rig is not None:
            return
        for error in add_transforms(self._tree, message.transforms):
            self._complain("/tf_static", error)
        self._try()

    def _complain(self, topic: str, error: DepthPoseError) -> None:
        self._node.get_logger().error(f"{topic}: {printable(error)}", throttle_duration_sec=LOG_EVERY_S)

    def _place(self, frame: str) -> Array | None:
        return self._tree.find(self._world, frame)

    def _try(self) -> None:
        """Build the rig once everything is known."""
        if self._done is None or len(self._infos) < len(self.topics):
            return
        cameras = []
        T_upright_world = upright_from(self._up)
        for i, topic in enumerate(self.topics):
            info = self._infos[i]
            T_world_camera = self._poses[i] if self._poses is not None else self._place(info.header.frame_id)
            if T_world_camera is None:
                return
            try:
                camera = camera_of_rectified(info)
            except DepthPoseError as error:  # the next message may be valid
                self._complain(f"CameraInfo of {topic}", error)
                del self._infos[i]
                return
            cameras.append(RigCamera(topic, camera, np.linalg.inv(T_upright_world @ T_world_camera)))
        self.rig = Rig(tuple(cameras), self.topics, self._up)
        self._done(self.rig)


def add_transforms(tree: TransformTree, transforms: Sequence[TransformStamped]) -> list[ConfigError]:
    """Add the transforms of a ``/tf_static`` message; return the errors of those that cannot be added."""
    return [error for t in transforms if (error := _add_transform(tree, t)) is not None]


def _add_transform(tree: TransformTree, t: TransformStamped) -> ConfigError | None:
    p, q = t.transform.translation, t.transform.rotation
    try:
        tree.add(t.header.frame_id, t.child_frame_id, pose_matrix([p.x, p.y, p.z, q.x, q.y, q.z, q.w]))
    except ConfigError as error:
        return error
    return None


def given_extrinsics(values: Sequence[float], cameras: int) -> list[Array] | None:
    """Read the parameter ``extrinsics``: seven numbers per camera; None if it is not set."""
    if len(values) < 7:  # [0.0] is the empty default: an empty list has no type
        return None
    if len(values) != 7 * cameras:
        raise ConfigError(
            f"extrinsics has {len(values)} numbers; {cameras} cameras need {7 * cameras}: "
            "x y z qx qy qz qw of each optical frame in the world"
        )
    return [pose_matrix(values[7 * i : 7 * i + 7]) for i in range(cameras)]
