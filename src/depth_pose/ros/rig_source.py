"""Where the volume node's cameras are: a rig file, or CameraInfo with extrinsics or static transforms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo

from depth_pose.errors import ConfigError
from depth_pose.geometry import quat_to_matrix
from depth_pose.io.decode import camera_from_info
from depth_pose.volume.rig import RigCamera
from depth_pose.volume.rigfile import Rig, load_rig, upright_from

Array = NDArray[np.float64]


class RigSource:
    """Collects the cameras of a rig until all are known, and then calls back once.

    Parameters
    ----------
    node : Node
        With the parameters ``rig``, ``topics``, ``info_topics``, ``extrinsics``, ``world_frame``, ``up``.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._done: Callable[[Rig], None] | None = None
        self.rig: Rig | None = None
        file = node.get_parameter("rig").value
        if file:
            self.rig = load_rig(Path(file))
            self.topics: tuple[str, ...] = self.rig.topics
            return
        self.topics = tuple(t for t in node.get_parameter("topics").value if t)
        if not self.topics:
            raise ConfigError("give the parameter rig (a rig file), or topics (a list of image topics)")
        self._up = str(node.get_parameter("up").value)
        self._poses = _given_extrinsics(node.get_parameter("extrinsics").value, len(self.topics))
        self._infos: dict[int, CameraInfo] = {}
        self._edges: dict[str, tuple[str, Array]] = {}
        upright_from(self._up)

    def listen(self, done: Callable[[Rig], None]) -> None:
        """Subscribe to what is not known yet; ``done`` is called with the rig, at once if it is known."""
        if self.rig is not None:
            done(self.rig)
            return
        self._done = done
        named = [t for t in self._node.get_parameter("info_topics").value if t]
        infos = named or [t.rpartition("/")[0] + "/camera_info" for t in self.topics]
        if len(infos) != len(self.topics):
            raise ConfigError(f"info_topics has {len(infos)} names; there are {len(self.topics)} topics")
        for i, topic in enumerate(infos):
            for durability in (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL):
                kept = durability == DurabilityPolicy.TRANSIENT_LOCAL
                reliability = ReliabilityPolicy.RELIABLE if kept else ReliabilityPolicy.BEST_EFFORT
                qos = QoSProfile(depth=1, durability=durability, reliability=reliability)
                self._node.create_subscription(CameraInfo, topic, self._info_callback(i), qos)
        if self._poses is None:
            self._listen_to_transforms()

    def missing(self) -> list[str]:
        """Say what is still unknown."""
        if self.rig is not None:
            return []
        out = [f"CameraInfo of {t}" for i, t in enumerate(self.topics) if i not in self._infos]
        if self._poses is None:
            world = self._node.get_parameter("world_frame").value
            frames = [m.header.frame_id for m in self._infos.values()]
            out += [f"transform from {world} to {f}" for f in frames if self._to_world(f) is None]
        return out

    def _info_callback(self, index: int) -> Callable[[CameraInfo], None]:
        def take(info: CameraInfo) -> None:
            if self.rig is None:
                self._infos[index] = info
                self._try()

        return take

    def _listen_to_transforms(self) -> None:
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError as error:
            raise ConfigError(
                "the cameras' places are unknown: static transforms need the package tf2_msgs, which is not "
                "installed; give the parameter rig or extrinsics"
            ) from error
        kept = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._node.create_subscription(TFMessage, "/tf_static", self._take_transforms, kept)

    def _take_transforms(self, message: Any) -> None:
        for t in message.transforms:
            p, q = t.transform.translation, t.transform.rotation
            matrix = pose_matrix([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
            self._edges[t.child_frame_id.lstrip("/")] = (t.header.frame_id.lstrip("/"), matrix)
        self._try()

    def _to_world(self, frame: str) -> Array | None:
        """``T_world_frame`` along the static transforms; None where they do not lead to the world."""
        world = str(self._node.get_parameter("world_frame").value).lstrip("/")
        at, T_at_frame = frame.lstrip("/"), np.eye(4)
        for _ in range(len(self._edges) + 1):
            if at == world:
                return T_at_frame
            if at not in self._edges:
                return None
            at, T_parent_at = self._edges[at]
            T_at_frame = T_parent_at @ T_at_frame
        return None

    def _try(self) -> None:
        """Make the rig once everything is known."""
        if self.rig is not None or self._done is None or len(self._infos) < len(self.topics):
            return
        cameras = []
        T_upright_world = upright_from(self._up)
        for i, topic in enumerate(self.topics):
            info = self._infos[i]
            T_world_camera = (
                self._poses[i] if self._poses is not None else self._to_world(info.header.frame_id)
            )
            if T_world_camera is None:
                return
            camera = camera_from_info(info.k, info.d, info.width, info.height, info.distortion_model)
            cameras.append(RigCamera(topic, camera, np.linalg.inv(T_upright_world @ T_world_camera)))
        self.rig = Rig(tuple(cameras), self.topics, self._up)
        self._done(self.rig)


def pose_matrix(values: Sequence[float]) -> Array:
    """Transform (4, 4) of x, y, z, qx, qy, qz, qw."""
    quat = np.asarray(values[3:], np.float64)
    size = float(np.linalg.norm(quat))
    if size < 1e-6:
        raise ConfigError(f"the pose {list(values)} has no rotation: its quaternion is zero")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = quat_to_matrix(quat / size), values[:3]
    return T


def _given_extrinsics(values: Sequence[float], cameras: int) -> list[Array] | None:
    if len(values) < 7:  # [0.0] is the empty default: an empty list has no type
        return None
    if len(values) != 7 * cameras:
        raise ConfigError(
            f"extrinsics has {len(values)} numbers; {cameras} cameras need {7 * cameras}: "
            "x y z qx qy qz qw of each optical frame in the world"
        )
    return [pose_matrix(values[7 * i : 7 * i + 7]) for i in range(cameras)]
