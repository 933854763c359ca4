"""Further outputs of the denoise node: label images, the floor, and the transform of its upright frame."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from sensor_msgs.msg import Image

from depth_pose.core.config import MountConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.mount import UPRIGHT, rotation_sensor_upright
from depth_pose.detect.floor import Floor, FloorFinder
from depth_pose.io.clouds import OPTICAL, R_BODY_OPTICAL
from depth_pose.ros.messages.basics import make_header
from depth_pose.ros.transport.level import Level
from depth_pose.ros.transport.tf import LATCHED, Transforms, pose_of, stamped
from depth_pose.track.label_image import LabelImage
from depth_pose.track.person_view import FramePeople

if TYPE_CHECKING:
    from depth_pose.ros.nodes.node_base import StageNode

FLOOR = "floor"
"""Name of the floor's frame, without the prefix."""

_ROLL_SEEN = np.cos(np.radians(60.0))
"""Minimum component of up in the image plane to measure a roll; smaller if a sensor looks straight down."""
_ROLL_DEG = 40.0
"""A roll that differs from that of the mounting by more than this (degrees) is reported."""


class RoomOutputs:
    """Publishes ``labels`` and ``floor``, and on ``/tf_static`` the floor and the upright frame.

    Labels are drawn only with a subscriber.

    Parameters
    ----------
    node : StageNode
        With the parameters of `depth_pose.ros.nodes.parameters.TF` and ``LEVEL``, and ``config``.
    """

    def __init__(self, node: StageNode) -> None:
        self._node = node
        self._labels = node.publisher(Image, "labels", reliable=True, counted=False)
        self._floor = node.open_publisher(PoseStamped, "floor", LATCHED)
        self._tf, self._prefix = bool(node.value("tf")), str(node.value("tf_prefix"))
        self._statics = Transforms(node, "the parameter tf", static=True) if self._tf else None
        self._upright: tuple[str, float] | None = None
        self._level = Level(node)
        self.doubt = ""
        """Reason why the roll of the mounting looks wrong; empty if it does not."""
        self._take_settings()

    def _take_settings(self) -> None:
        self._config = self._node.config
        self._mount: MountConfig = self._config.mount
        self._published_floor: Floor | None = None

    def publish(
        self, frame: DepthFrame, people: FramePeople, finder: FloorFinder, *, is_turned: bool = False
    ) -> None:
        """Publish the enabled outputs of one frame.

        Parameters
        ----------
        frame : DepthFrame
            As measured by the sensor.
        people : FramePeople
            Of this frame.
        finder : FloorFinder
            Holds the floor.
        is_turned : bool
            Whether a cloud was turned to optical axes (`depth_pose.io.clouds.is_body_frame`).
        """
        self._is_turned = is_turned
        if self._node.config is not self._config:
            self._take_settings()
        if self._labels.get_subscription_count():
            self._labels.publish(labels_to_msg(LabelImage.of(people, frame, self._mount).draw(), frame))
        if finder.floor is not None and finder.floor is not self._published_floor:
            self._published_floor = finder.floor
            self._tell_floor(frame, finder.floor)
        if (frame.frame_id, self._mount.roll) != self._upright:
            self._tell_upright(frame)
            self._tell_optical(frame)

    def take_level(self, frame: DepthFrame, finder: FloorFinder) -> None:
        """Give a finder the measured direction of up, and compare it with the roll of the mounting."""
        up = self._level.up(frame.frame_id)
        if up is None:
            return
        finder.up = rotation_sensor_upright(self._mount.roll).T @ up
        roll = float(np.degrees(np.arctan2(-up[0], -up[1]))) % 360.0
        away = (roll - self._mount.roll + 180.0) % 360.0 - 180.0
        rolled = np.hypot(up[0], up[1]) > _ROLL_SEEN and abs(away) > _ROLL_DEG
        says = f"{self._level.source} says that the sensor is rolled by {roll:.0f} degrees"
        self.doubt = f"{says}: set mount.roll: {roll:.0f} for all nodes" if rolled else ""

    def _tell_floor(self, frame: DepthFrame, floor: Floor) -> None:
        T_sensor_floor = floor.turned(rotation_sensor_upright(self._mount.roll)).T_camera_floor
        header = make_header(frame.stamp_ns, frame.frame_id)
        self._floor.publish(PoseStamped(header=header, pose=pose_of(T_sensor_floor)))
        if self._statics is not None and self._tf:
            name = self._prefix + FLOOR
            self._statics.publish([stamped(frame.stamp_ns, frame.frame_id, name, T_sensor_floor)])

    def _tell_upright(self, frame: DepthFrame) -> None:
        """Publish the transform of the upright frame, if it is not the sensor's own."""
        self._upright = frame.frame_id, self._mount.roll
        if self._mount.roll % 360.0 == 0.0 or importlib.util.find_spec("tf2_msgs") is None:
            return
        if self._statics is None:
            self._statics = Transforms(self._node, "the upright frame", static=True)
        T = np.eye(4)
        T[:3, :3] = rotation_sensor_upright(self._mount.roll)
        self._statics.publish([stamped(frame.stamp_ns, frame.frame_id, frame.frame_id + UPRIGHT, T)])

    def _tell_optical(self, frame: DepthFrame) -> None:
        """Publish the optical frame of a cloud that came in a body frame."""
        body = frame.frame_id.removesuffix(OPTICAL)
        if not self._is_turned or body == frame.frame_id or importlib.util.find_spec("tf2_msgs") is None:
            return
        if self._statics is None:
            self._statics = Transforms(self._node, "the optical frame", static=True)
        T = np.eye(4)
        T[:3, :3] = R_BODY_OPTICAL
        self._statics.publish([stamped(frame.stamp_ns, body, frame.frame_id, T)])


def labels_to_msg(labels: NDArray[np.uint8], frame: DepthFrame) -> Image:
    """Message of a label image, with the stamp and the frame of the depth image."""
    height, width = labels.shape
    return Image(
        header=make_header(frame.stamp_ns, frame.frame_id),
        height=height,
        width=width,
        encoding="mono8",
        step=width,
        data=labels.tobytes(),
    )
