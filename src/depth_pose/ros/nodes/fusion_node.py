"""Node: skeletons of several cameras -> ``/depth_pose/room/skeletons``, ``markers`` and ``/tf`` of the room.

Each camera has a suite of its own, on any host, whose skeletons are merged in the room's frame: one for each
person, at the rate of the fastest camera. A camera that stops, lags or was moved is excluded until it agrees
again; ``/diagnostics`` reports it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from depth_pose_msgs.msg import SkeletonArray
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.exceptions import InvalidTopicNameException
from rclpy.validate_topic_name import validate_topic_name
from visualization_msgs.msg import MarkerArray

from depth_pose.body.bodies import find_body
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.result import Skeleton
from depth_pose.io.skeleton_cdr import write_people
from depth_pose.rooms.merger import RoomMerger
from depth_pose.rooms.rigfile import load_rig
from depth_pose.rooms.watch import CameraState
from depth_pose.ros.messages.basics import stamp_to_ns
from depth_pose.ros.messages.checks import check_people
from depth_pose.ros.messages.skeletons import msg_to_skeleton
from depth_pose.ros.nodes.bank_node import BankNode
from depth_pose.ros.nodes.node_base import Deferred, Input
from depth_pose.ros.nodes.parameters import BANK, OTHERS, TF
from depth_pose.ros.nodes.rep155_outputs import Rep155Outputs
from depth_pose.ros.nodes.standard_outputs import StandardOutputs
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.setting import Setting
from depth_pose.ros.transport.camera_intake import CameraIntake
from depth_pose.ros.transport.drawing import skeletons_to_markers
from depth_pose.ros.transport.room_poses import RoomPoses
from depth_pose.ros.transport.tf import Transforms, skeletons_to_transforms

SKELETONS = "depth_pose/skeletons"
"""Topic of a suite's skeletons, below the camera's namespace."""

SETTINGS: tuple[Setting, ...] = (
    BANK,
    Setting("rig", "", "Rig file: names and poses of the cameras; empty: poses from /tf_static"),
    Setting("topics", [""], "Skeletons of each camera; default: /CAMERA/depth_pose/skeletons of the rig"),
    Setting("room_frame", "room", "Frame of the merged skeletons: z up, the floor at z = 0"),
    *TF,
    *OTHERS,
)
"""Parameters besides those of the filter; of the bank, only the body is used (``rep155``)."""

_LOOK_S = 0.2
"""Seconds between two checks of the cameras."""

_REMIND_S = 10.0
"""Seconds between two reminders of cameras that have sent nothing."""

_FORGET_NS = 1_000_000_000
"""A jump back of the stamps by more than this (ns) is a replay from the start."""


class FusionNode(BankNode):
    """Merges the skeletons of several cameras."""

    SECTIONS = ("smooth",)
    SETTINGS = SETTINGS

    def __init__(self) -> None:
        self._answered_ns: int | None = None
        self._pace: int | None = None
        super().__init__("fusion")
        self.create_timer(_LOOK_S, self._look, clock=self.steady_clock)

    def prepare(self) -> None:
        """Read the rig, and open the topics."""
        topics = [t for t in self.value("topics") if t]
        self._topics = topics
        self._names = [t.removesuffix("/skeletons").removesuffix("/depth_pose").strip("/") for t in topics]
        self._given: list[Any] = [None] * len(topics)
        self._clock_offsets_s: Sequence[float] = ()
        if self.value("rig"):
            self._read_rig(Path(self.value("rig")))
        if not self._topics:
            raise ConfigError("give the parameter rig (a rig file), or topics (the skeletons of each camera)")
        for topic in self._topics:
            _check_name(topic)
        super().prepare()

    def _read_rig(self, path: Path) -> None:
        try:
            rig = load_rig(path)
        except InputError as error:  # a restart would not help
            raise ConfigError(str(error)) from error
        self._names = [camera.name for camera in rig.cameras]
        self._given = [camera.T_room_camera for camera in rig.cameras]
        self._clock_offsets_s = rig.clock_offsets
        self._topics = self._topics or [f"/{name}/{SKELETONS}" for name in self._names]
        if len(self._topics) != len(self._names):
            raise ConfigError(
                f"topics has {len(self._topics)} names; {path} has {len(self._names)} cameras: "
                + ", ".join(self._names)
            )

    def make_stage(self, config: PipelineConfig) -> RoomMerger:
        """Build the merger."""
        frame_id, offsets_s = self.value("room_frame"), self._clock_offsets_s
        return RoomMerger(self._names, self._given, frame_id, offsets_s, config.smooth)

    def open_outputs(self) -> None:
        """Create the publishers for other programs: reliable, which suits every subscriber."""
        self._skeletons = self.publisher(SkeletonArray, "room/skeletons", reliable=True)
        self._markers = self.publisher(MarkerArray, "room/markers", reliable=True, counted=False)
        self._poses = RoomPoses(self, self.value("room_frame"), self._given)
        prefix = self.value("tf_prefix")
        self._transforms = Transforms(self, "the parameter tf") if self.value("tf") else None
        self._rep155: Rep155Outputs | None = None
        if self.value("rep155"):
            body = self.bank.body if self.value("bank") else find_body("embedded")
            self._rep155 = Rep155Outputs(self, body, prefix)
        self._others = StandardOutputs(self, "room/detections")

    def inputs(self) -> Sequence[Input]:
        """Subscribe to the skeletons of all cameras."""
        return [Input(SkeletonArray, topic) for topic in self._topics]

    def make_intake(self) -> CameraIntake:
        """Receive the cameras' messages as they arrive."""
        return CameraIntake(self, SkeletonArray, self._topics)

    # Answering

    def stamp_ns(self, *messages: tuple[int, SkeletonArray]) -> int:
        """Return the stamp of the answer to a batch, in the room's clock."""
        assert self._answered_ns is not None
        return self._answered_ns

    def answer(self, *messages: tuple[int, SkeletonArray]) -> None:
        """Take the cameras' skeletons; publish the merged ones once the fastest camera has sent its own."""
        taken = [
            (camera, message)
            for camera, message in messages
            if self.guard(self._topics[camera], self._take, camera, message)
        ]
        self._say_news()
        self._pace = self.stage.watch.fastest(self._pace)
        stamps = [
            self.stage.room_stamp_ns(camera, stamp_to_ns(message.header.stamp))
            for camera, message in taken
            if camera == self._pace
        ]
        if not stamps or not self._is_new(max(stamps)):
            raise Deferred
        self._answered_ns = max(stamps)
        self._publish(self.stage.skeletons_at(self._answered_ns), self._answered_ns)

    def _take(self, camera: int, message: SkeletonArray) -> bool:
        """Take a camera's message; return whether it takes part in the room."""
        ids = [s.body_id for s in message.skeletons]
        check_people("skeletons", ids)
        is_haunted = self.stage.watch.is_haunted(camera, ids, self._now_s())
        skeletons = [msg_to_skeleton(s) for s in message.skeletons[: 0 if is_haunted else None]]
        stamp_ns, frame_id = stamp_to_ns(message.header.stamp), message.header.frame_id
        self.stage.T_room_camera[camera] = self._poses.find(camera, frame_id)
        return bool(self.stage.add(camera, stamp_ns, skeletons, self._now_s(), ids))

    def _is_new(self, stamp_ns: int) -> bool:
        """Whether a stamp is later than the last answer's, or a replay has restarted."""
        last_ns = self._answered_ns
        return last_ns is None or stamp_ns > last_ns or stamp_ns < last_ns - _FORGET_NS

    def _publish(self, skeletons: Sequence[Skeleton], stamp_ns: int) -> None:
        frame_id = self.stage.frame_id
        self._skeletons.publish(write_people(skeletons, stamp_ns, frame_id))
        if self._markers.get_subscription_count():
            self._markers.publish(skeletons_to_markers(skeletons, stamp_ns, frame_id))
        if self._transforms is not None and self._transforms.is_heard:
            nobody = Skeleton.lost(stamp_ns, frame_id)
            self._transforms.publish(skeletons_to_transforms(skeletons, nobody, self.value("tf_prefix")))
        if self._rep155 is not None:
            self._rep155.publish(skeletons, stamp_ns, frame_id)
        self._others.publish(skeletons, stamp_ns, frame_id)
        self.statistics.values["people"] = len(skeletons)

    # Watching

    def _look(self) -> None:
        """Detect cameras that stopped, and publish the cameras' poses."""
        if self.stage is None or not self.is_active:
            return
        self.stage.check(self._now_s())
        self._say_news()
        watched = zip(self._topics, self.stage.watch.cameras, strict=True)
        waits = [topic for topic, camera in watched if camera.state == CameraState.WAITING]
        if waits:
            what = f"nothing has come yet on {', '.join(waits)}: do their suites run, in this ROS_DOMAIN_ID?"
            self.get_logger().warning(what, throttle_duration_sec=_REMIND_S, skip_first=True)
        self._poses.publish(self.get_clock().now().nanoseconds)

    def _say_news(self) -> None:
        for line in self.stage.watch.news():
            self.get_logger().warning(line)

    def judge(self) -> tuple[bytes, str]:
        """Return level and text: excluded cameras and missing transforms, else those of every node."""
        level, words = super().judge()
        if self.stage is None or not self.is_active:
            return level, words
        missing = [f"{self.stage.frame_id} to {frame}" for frame in self._poses.missing()]
        if missing:
            return DiagnosticStatus.WARN, f"waits for the transform from {', '.join(missing)}"
        cameras = self.stage.watch.cameras
        out = [f"{c.name} {c.state.value}" for c in cameras if c.state != CameraState.USED]
        out += dict.fromkeys(c.misfit for c in cameras if c.misfit)
        return (DiagnosticStatus.WARN, ", ".join(out)) if out else (level, words)

    def more_statuses(self) -> list[DiagnosticStatus]:
        """Return a status for each camera."""
        if self.stage is None:
            return []
        now_s, out = self._now_s(), []
        for of, offset_s in zip(self.stage.watch.cameras, self.stage.clock_offsets_s, strict=True):
            values = {
                "rate_hz": of.rate_hz,
                "age_s": math.nan if of.heard_s is None else now_s - of.heard_s,
                "delay_s": of.delay_s,
                "residual_m": of.residual_m,
                "clock_offset_s": offset_s,
            }
            status = DiagnosticStatus(name=f"{self.get_fully_qualified_name()}: {of.name}")
            is_good = of.state == CameraState.USED and not of.misfit
            status.level = DiagnosticStatus.OK if is_good else DiagnosticStatus.WARN
            status.message, status.hardware_id = of.misfit or of.state.value, of.name
            status.values = [KeyValue(key=k, value=f"{v:.3f}") for k, v in values.items()]
            out.append(status)
        return out

    def _now_s(self) -> float:
        return float(self.get_clock().now().nanoseconds * 1e-9)


def _check_name(topic: str) -> None:
    """Raise ConfigError if a text is not a valid topic name."""
    try:
        validate_topic_name(topic)
    except InvalidTopicNameException as error:
        what = f"{topic!r} is not a valid topic name; give all cameras' topics by the parameter topics"
        raise ConfigError(what) from error


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a stop signal; return the exit code."""
    return run_node(FusionNode, args)


if __name__ == "__main__":
    sys.exit(main())
