"""The direction of up from an IMU or the transforms of a robot."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Imu

from depth_pose.core.rotations import unit_vectors
from depth_pose.rooms.transform_tree import TransformTree
from depth_pose.ros.transport.host import TopicHost
from depth_pose.ros.transport.rig_source import add_transforms
from depth_pose.ros.transport.tf import TF_QUEUE, tf_message

Array = NDArray[np.float64]

_GRAVITY = 9.80665
_AT_REST = 0.05
"""A reading that differs from gravity by more than this share is not from a sensor at rest."""
_EVERY_S = 0.02
"""Minimum time between readings used: some IMUs send a thousand a second."""
_SHARE = 0.05
"""Weight of a new reading; about half a second of readings counts."""
_FEWEST = 10
"""Number of readings before the IMU is used."""


class Level:
    """Subscriber to an IMU or to transforms for the direction of up.

    An accelerometer at rest measures the reaction to gravity, which points up (REP-145).

    Parameters
    ----------
    node : TopicHost
        With the parameters of `depth_pose.ros.nodes.parameters.LEVEL`.
    clock : callable
        Seconds; for tests.
    """

    def __init__(self, node: TopicHost, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._tree = clock, TransformTree()
        self._imu, self._level = str(node.value("imu_topic")), str(node.value("level_frame"))
        self._mean, self._count, self._frame, self._taken = np.zeros(3), 0, "", -np.inf
        if self._imu:
            node.latch(Imu, self._imu, self.take_reading)
        if self._imu or self._level:
            message = tf_message("the direction of up in the sensor's frame")
            for topic in ("/tf_static", "/tf"):
                node.latch(message, topic, self.take_transforms, TF_QUEUE)

    @property
    def source(self) -> str:
        """Source of the direction; empty if none is set."""
        return self._imu or self._level

    def take_reading(self, reading: Imu) -> None:
        """Add an accelerometer's reading."""
        now = self._clock()
        if now - self._taken < _EVERY_S:
            return
        self._taken = now
        a = reading.linear_acceleration
        pushed = np.array([a.x, a.y, a.z])
        if not abs(float(np.linalg.norm(pushed)) / _GRAVITY - 1.0) < _AT_REST:
            return
        if reading.header.frame_id != self._frame:
            self._frame, self._count = reading.header.frame_id, 0
        self._count += 1
        self._mean = self._mean + max(_SHARE, 1.0 / self._count) * (pushed - self._mean)

    def take_transforms(self, message: Any) -> None:
        """Add the transforms of a message; those without a rotation are left out."""
        add_transforms(self._tree, message.transforms)

    def up(self, frame_id: str) -> Array | None:
        """Return the direction of up in a sensor's frame, unit vector (3,); None if unknown."""
        if self._imu:
            if self._count < _FEWEST:
                return None
            same = self._frame.lstrip("/") == frame_id.lstrip("/")
            T = np.eye(4) if same else self._tree.find(frame_id, self._frame)
            return None if T is None else np.asarray(unit_vectors(T[:3, :3] @ self._mean))
        if self._level:
            T = self._tree.find(frame_id, self._level)
            return None if T is None else np.asarray(T[:3, 2])
        return None
