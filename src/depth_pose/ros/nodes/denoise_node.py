"""Node: depth image or cloud of a sensor -> people's points, ``/depth_pose/points``, and their ids."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from depth_pose_msgs.msg import Packed, SkeletonArray
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

from depth_pose.core.config import PipelineConfig
from depth_pose.core.frame import DepthFrame
from depth_pose.core.mount import rotate_upright
from depth_pose.core.printable import printable
from depth_pose.core.stamps import StampFilter
from depth_pose.detect.input_repair import InputRepair
from depth_pose.io import clouds, compressed
from depth_pose.io.calibration import is_rectified
from depth_pose.io.camera_infos import CameraInfos
from depth_pose.io.compressed import TOPIC_ENDING
from depth_pose.io.decode import WRONG_ORDER
from depth_pose.io.depth_unit import UnitWatch, unit_of
from depth_pose.perception import Perception
from depth_pose.ros.messages import people
from depth_pose.ros.messages.basics import first_stamp_ns, stamp_to_ns
from depth_pose.ros.messages.frames import has_wrong_order, image_to_frame, msg_to_frame
from depth_pose.ros.nodes.node_base import Deferred, Drop, Input, StageNode
from depth_pose.ros.nodes.parameters import DENOISE
from depth_pose.ros.nodes.room_outputs import RoomOutputs
from depth_pose.ros.nodes.topic_node import BUSY_REASONS
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.transport.frames_in_flight import LONGEST_S, FramesInFlight
from depth_pose.ros.transport.pace import Pace
from depth_pose.track.nobody import NobodyWatch
from depth_pose.track.upside_down import UpsideDownWatch

_INFOS = 16
"""Queue length for CameraInfos: with one, those of another camera could displace all of this camera's."""


_SOLE_AFTER = 10
"""Number of CameraInfos of another frame_id, all from one publisher, after which they are used for the image:
some drivers name the two differently."""


class DenoiseNode(StageNode):
    """Finds the people and denoises their points (Sec. 4).

    Live, it begins no frame while several are in flight, so that no time is spent on frames that a later node
    would drop. The published skeletons tell which frames are done.

    Attributes
    ----------
    held : deque
        Images waiting for the first CameraInfo of their camera.
    """

    LOGS_BUSY = False  # but see `Pace`
    SECTIONS = ("mount", "segment", "denoise", "match")
    SETTINGS = DENOISE

    def __init__(self) -> None:
        self._infos = CameraInfos("")
        self._units = UnitWatch("the parameter depth_scale")
        self._repair = InputRepair()
        self._said: set[str] = set()
        self._rectified = False
        self.held: deque[Image | CompressedImage] = deque()
        self._in_flight = FramesInFlight()
        self._pace = Pace()
        self._order = StampFilter()
        self._order_doubt = self._axes_doubt = ""
        super().__init__("denoise")
        if not self.lossless:
            self.create_timer(LONGEST_S, self._begin_waiting, clock=self.steady_clock)

    def prepare(self) -> None:
        """Build the stage, and compile what writes its output."""
        people.warm_up()
        self._repair.warm_up()
        super().prepare()

    def make_stage(self, config: PipelineConfig) -> Perception:
        """Build the first stage."""
        self._mounting = UpsideDownWatch(config.segment)
        self._nobody = NobodyWatch(config.segment)
        self._repair.reset()
        return Perception(config.segment, config.denoise, config.mount, config.match.method == "joints")

    def open_outputs(self) -> None:
        """Create the publishers of the people, and of their points for other programs."""
        self._people = self.publisher(Packed, "people")
        self._points = self.publisher(PointCloud2, "points", counted=False)
        self._room = RoomOutputs(self)

    def inputs(self) -> Sequence[Input]:
        """Subscribe to a cloud, or to an image and its CameraInfo; live, also to the resulting skeletons."""
        if not self.lossless:
            self.listen(SkeletonArray, "skeletons", self._take_answer, raw=True)
        self._unit_m: float | None = self.value("depth_scale") or None
        cloud_topic = self.value("cloud_topic")
        if cloud_topic:
            clouds.warm_up()
            return [Input(PointCloud2, cloud_topic, sensor=True)]
        self._infos = CameraInfos(self.resolve_topic_name(self.value("info_topic")))
        self.latch(CameraInfo, self.value("info_topic"), self.take_info, _INFOS)
        topic = self.value("image_topic")
        self._rectified = is_rectified(self.resolve_topic_name(topic))
        compressed.warm_up()
        kinds = (CompressedImage, Image) if topic.endswith(TOPIC_ENDING) else (Image, CompressedImage)
        return [Input(kinds[0], topic, sensor=True, others=kinds[1:])]

    def forget(self) -> None:
        """Drop the waiting images."""
        self.held.clear()
        self._pace.forget()
        self._in_flight.forget()
        self._order.reset()

    def answer(self, message: Any) -> None:
        """Find the people in one frame."""
        if self._in_flight.has_waiting:
            self.drop("overtaken", "a newer frame came before this one was begun")
        if not self._in_flight.offer(message, time.monotonic()):
            raise Deferred
        frame = self._frame(message)
        if reason := self._order.why_skipped(frame.stamp_ns):
            raise Drop("stamp out of order", f"a frame is skipped: {reason}")
        upright = rotate_upright(self._repair.apply(frame), self.config.mount)
        self._room.take_level(frame, self.stage.floor_finder)
        found = self.stage.perceive(upright)
        self._people.publish(people.people_to_msg(found))
        if self._points.get_subscription_count():
            self._points.publish(people.people_to_cloud(found))
        self._in_flight.begin(found.stamp_ns, time.monotonic())
        self._pace.begin()
        is_turned = isinstance(message, PointCloud2) and frame.frame_id != message.header.frame_id
        self._room.publish(frame, found, self.stage.floor_finder, is_turned=is_turned)
        if is_turned and not self._axes_doubt:
            self._axes_doubt = f"{clouds.BODY_AXES}{frame.frame_id}"
        self._mounting.look(upright, found)
        is_found = bool(found.persons)
        self._nobody.look(
            upright, is_found=is_found, is_answered=is_found, rejected=self.stage.rejected_counts
        )
        self._say()
        self.statistics.values["people"] = len(found.persons)
        self.statistics.values["people cut off or half hidden"] = sum(
            p.is_cut_below or p.is_cut_beside for p in found.persons
        )
        for reason, count in self.stage.rejected_counts.items():
            self.statistics.values[f"ignored: {reason}"] = count

    def _frame(self, message: Any) -> DepthFrame:
        """Convert a message.

        Raises
        ------
        Deferred
            Where its camera is not known yet.
        """
        if isinstance(message, PointCloud2):
            frame, unit_m = msg_to_frame(message, self._unit_m), 1.0
        else:
            info = self._find_info(message.header.frame_id)
            if info is None:
                self._hold(message)
                raise Deferred
            frame = image_to_frame(message, info, self._rectified, self._unit_m)
            is_plain = isinstance(message, Image)
            if is_plain and not self._order_doubt and has_wrong_order(message):
                self._order_doubt = WRONG_ORDER
            unit_m = unit_of(message.encoding if is_plain else message.format.partition(";")[0].strip())
        if self._unit_m is None:
            self._units.look(frame.depth, unit_m)
        return frame

    def _find_info(self, frame_id: str) -> CameraInfo | None:
        """Return the CameraInfo of an image's camera; None if there is none yet."""
        found = self._infos.find(frame_id)
        if found is not None or self._infos.count < _SOLE_AFTER:
            return found
        if self.count_publishers(self.resolve_topic_name(self.value("info_topic"))) == 1:
            self._infos.accept_only()
        return self._infos.find(frame_id)

    def _say(self) -> None:
        """Log warnings about the camera or its unit, once for each kind."""
        lines = self._infos.warnings | self._doubts()
        for kind, line in lines.items():
            if kind not in self._said:
                self._said.add(kind)
                self.get_logger().warning(printable(line))

    def _doubts(self) -> dict[str, str]:
        """Return warnings about the images as a whole, by kind."""
        unit = self._units.doubt if self._units.is_decided else ""
        mounting = self._room.doubt or self._mounting.doubt
        # the unit has a line of its own, with the parameter that sets it
        nobody = "" if unit or self._nobody.cause == "unit" else self._nobody.doubt
        kinds = {"unit": unit, "mount": mounting, "input": self._repair.doubt, "order": self._order_doubt}
        kinds |= {"axes": self._axes_doubt, "nobody": nobody}
        return {kind: line for kind, line in kinds.items() if line}

    def judge(self) -> tuple[bytes, str]:
        """Return the level and the text of this second's diagnostics, with warnings about the images."""
        level, words = super().judge()
        if self.is_active and not self.lossless:
            slow = self._pace.look(sum(self.statistics.drops[r] for r in BUSY_REASONS), time.monotonic())
            if slow:
                self.get_logger().warning(slow)
        if level == DiagnosticStatus.OK and self.is_active:
            doubts = self._doubts()
            if doubts:
                return DiagnosticStatus.WARN, "; ".join(doubts.values())
        return level, words

    def _take_answer(self, message: bytes) -> None:
        """Record the arrival of a frame."""
        self._in_flight.arrive(first_stamp_ns(message), time.monotonic())
        self._pace.arrive()
        self._begin_waiting()

    def _begin_waiting(self) -> None:
        """Begin the waiting frame if it may begin now."""
        waited = self._in_flight.release(time.monotonic())
        if waited is not None:
            self.process((waited,))

    def _hold(self, image: Image | CompressedImage) -> None:
        """Keep an image until the first CameraInfo of its camera arrives."""
        if len(self.held) >= self.queue:
            last = self.held.popleft()
            self.drop("no CameraInfo", self._infos.why_none(last.header.frame_id))
        self.held.append(image)

    def take_info(self, info: CameraInfo) -> None:
        """Add a camera's calibration, and process the images that wait for it."""
        self._infos.add(info, stamp_to_ns(info.header.stamp))
        for name, value in self._infos.counts.items():
            self.statistics.counts[name] = value
        held = list(self.held)
        self.held.clear()
        for image in held:
            self.process((image,))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a stop signal; return the exit code."""
    return run_node(DenoiseNode, args)


if __name__ == "__main__":
    sys.exit(main())
