"""Node: silhouettes of several cameras, or one depth camera -> the pose of a person in loose clothing.

``/depth_pose/skeleton`` (source VOLUME) in the world frame, and ``/depth_pose/joint_states`` with the
anatomical angles. Images of one moment are brought together by their stamps; a camera that is late is
not waited for longer than ``patience``, one that is gone not at all, and ``/diagnostics`` says so. The
newest moment wins.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from depth_pose_msgs.msg import Skeleton as SkeletonMsg
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, JointState

from depth_pose.body.angles import ANGLES
from depth_pose.config import DenoiseConfig, SegmentConfig, from_mapping, options
from depth_pose.errors import ConfigError, InputError
from depth_pose.io.decode import decode_depth
from depth_pose.ros.conversions import make_header, skeleton_to_msg, stamp_to_ns
from depth_pose.ros.figures import Figures
from depth_pose.ros.intake import waiting
from depth_pose.ros.node_base import READY
from depth_pose.ros.parameters import Setting, describe
from depth_pose.ros.rig_source import RigSource
from depth_pose.ros.runner import run_node
from depth_pose.types import PERSON, DepthFrame
from depth_pose.volume.config import SpaceConfig, TrackConfig
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.moments import Moment, MomentGatherer
from depth_pose.volume.pipeline import DepthPipeline, SilhouettePipeline, VolumePose, make_pipeline
from depth_pose.volume.recordings import decode_silhouette, in_world
from depth_pose.volume.rigfile import Rig

SETTINGS: tuple[Setting, ...] = (
    Setting("model", "", "Volume model, made with 'depth-pose volume train'"),
    Setting("rig", "", "Rig file: topics, intrinsics and extrinsics of the cameras"),
    Setting("world_frame", "map", "Frame of the skeletons, and of the static transforms"),
    Setting("up", "z", "Axis of the world frame that points up, z or y; a rig file says its own"),
    Setting("tolerance", 0.004, "Stamps that differ by at most this are of one moment [s]", 0.0, 1.0),
    Setting("patience", 0.012, "How long a moment waits for a late camera [s]", 0.0, 1.0),
    Setting("gone_after", 0.5, "A camera silent for this long is gone and not waited for [s]", 0.05, 60.0),
    Setting("segment", True, "Depth: find the person in the image; false: it shows nothing else"),
)
"""Parameters beside those of `SpaceConfig` (``space.``) and `TrackConfig` (``track.``)."""

_LISTS: dict[str, tuple[list[Any], str]] = {
    "topics": ([""], "Image topics, where there is no rig file"),
    "info_topics": ([""], "Their CameraInfo topics; empty: camera_info beside each image"),
    "extrinsics": ([0.0], "x y z qx qy qz qw of each optical frame in the world; else /tf_static"),
}
_SECTIONS: dict[str, type] = {"space": SpaceConfig, "track": TrackConfig}
_TICK_S = 0.004
_LOG_EVERY_S = 5.0


class VolumeNode(Node):
    """The volume tracker on topics."""

    def __init__(self) -> None:
        super().__init__("volume", namespace="depth_pose")
        self.figures = Figures()
        self._pending: Moment | None = None
        self._pipeline: SilhouettePipeline | DepthPipeline | None = None
        self._told_gone: list[int] = []
        self._declare()
        if not self.value("model"):
            raise ConfigError("give the parameter model: a file that 'depth-pose volume train' made")
        try:
            self._model = VolumeModel.load(Path(self.value("model")))
            self._source = RigSource(self)
        except InputError as error:  # starting again will not help
            raise ConfigError(str(error)) from error
        self._config = {name: self._section(name, kind) for name, kind in _SECTIONS.items()}
        self._frame = str(self.value("world_frame"))
        self._extractor: Any = None
        reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        self._skeletons = self.create_publisher(SkeletonMsg, "skeleton", reliable)
        self._states = self.create_publisher(JointState, "joint_states", reliable)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._tell, clock=self._steady)
        self._source.listen(self._begin)

    # Parameters

    def value(self, name: str) -> Any:
        """Value of a parameter."""
        return self.get_parameter(name).value

    def _declare(self) -> None:
        given: dict[str, Parameter] = getattr(self, "_parameter_overrides", {})
        known = {s.name for s in SETTINGS} | set(_LISTS) | {"use_sim_time", "start_type_description_service"}
        known |= {f"{name}.{o.name}" for name, kind in _SECTIONS.items() for o in options(kind)}
        unknown = sorted(n for n in given if n not in known and not n.startswith("qos_overrides."))
        if unknown:
            raise ConfigError(f"the volume node has no parameter {', '.join(unknown)}")
        for s in SETTINGS:
            self._declare_one(given, s.name, s.default, describe(s.help, s.default, s.low, s.high, True))
        for name, (default, help) in _LISTS.items():
            self._declare_one(given, name, default, describe(help, "", None, None, True))
        for name, kind in _SECTIONS.items():
            for o in options(kind):
                descriptor = describe(o.help, o.default, o.low, o.high, True, o.unit, o.choices)
                self._declare_one(given, f"{name}.{o.name}", o.default, descriptor)

    def _declare_one(self, given: dict[str, Parameter], name: str, default: Any, descriptor: Any) -> None:
        value = given.get(name)
        if isinstance(default, float) and value is not None and value.type_ == Parameter.Type.INTEGER:
            given[name] = Parameter(name, Parameter.Type.DOUBLE, float(value.value))
        try:
            self.declare_parameter(name, default, descriptor)
        except Exception as error:  # rclpy raises a different class for each thing that is wrong
            raise ConfigError(f"parameter {name}: {error}") from error

    def _section(self, name: str, kind: type) -> Any:
        return from_mapping(kind, {o.name: self.value(f"{name}.{o.name}") for o in options(kind)})

    # Beginning

    def _begin(self, rig: Rig) -> None:
        """Make and warm up the pipeline, then listen."""
        self._rig = rig
        pipeline = make_pipeline(
            self._model, rig.cameras, self._config["space"], self._config["track"], self._frame
        )
        pipeline.warm_up()
        if isinstance(pipeline, DepthPipeline) and self.value("segment"):
            from depth_pose.steps.extract import PersonExtractor

            self._extractor = PersonExtractor(SegmentConfig(), DenoiseConfig())
            self._extractor.warm_up()
        self._pipeline = pipeline
        self._gatherer = MomentGatherer(
            len(rig.topics), self.value("tolerance"), self.value("patience"), self.value("gone_after")
        )
        sensor = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._images = [
            (self.create_subscription(Image, topic, callback, sensor), callback)
            for i, topic in enumerate(rig.topics)
            for callback in (self._callback(i),)
        ]
        self.create_timer(_TICK_S, self._check, clock=self._steady)
        self.get_logger().info(f"{self.get_name()} {READY}: listens to {', '.join(rig.topics)}")

    def _callback(self, camera: int) -> Callable[[Image], None]:
        def take(message: Image) -> None:
            late = self._gatherer.late[camera]
            stamp_ns = stamp_to_ns(message.header.stamp)
            self._gatherer.add(camera, stamp_ns, message, time.monotonic())
            if self._gatherer.late[camera] > late:
                self.get_logger().warning(
                    f"{self._rig.topics[camera]} is late: its moment was answered without it",
                    throttle_duration_sec=_LOG_EVERY_S,
                )
            self._check()

        return take

    def _check(self) -> None:
        moment = self._gatherer.take(time.monotonic())
        if moment is None:
            return
        if self._pending is not None:
            self.figures.drop("overtaken")
        self._pending = moment

    # Answering

    @property
    def has_pending(self) -> bool:
        """Whether a moment waits for `process_pending`."""
        return self._pending is not None

    def process_pending(self) -> None:
        """Answer the newest moment, once all that waits is taken in; whatever happens, the node lives."""
        for subscription, callback in self._images:
            for message, _ in waiting(subscription):
                callback(message)
        moment, self._pending = self._pending, None
        if moment is None or self._pipeline is None:
            return
        started = time.perf_counter()
        try:
            pose = self._estimate(moment)
        except InputError as error:
            self._drop("bad input", str(error))
            return
        except Exception as error:  # a node outlives every frame
            self.get_logger().error(traceback.format_exc(), throttle_duration_sec=_LOG_EVERY_S)
            self._drop("error", f"{type(error).__name__}: {error}")
            self._pipeline.reset()
            return
        self._publish(pose, moment.stamp_ns)
        latency_s = (self.get_clock().now().nanoseconds - moment.stamp_ns) / 1e9
        self.figures.answer(time.perf_counter() - started, latency_s)

    def _drop(self, reason: str, detail: str) -> None:
        self.figures.drop(reason)
        self.get_logger().warning(f"dropped, {reason}: {detail}", throttle_duration_sec=_LOG_EVERY_S)

    def _estimate(self, moment: Moment) -> VolumePose:
        """Decode what there is and run the pipeline; an image that is damaged counts as missing."""
        depth = isinstance(self._pipeline, DepthPipeline)
        images: list[Any] = []
        for i, message in enumerate(moment.images):
            try:
                images.append(None if message is None else _decode(message, depth))
                self._check_size(i, images[-1])
            except InputError as error:  # noqa: PERF203
                images[i:] = [None]
                self._drop("bad image", f"{self._rig.topics[i]}: {error}")
        there, live = (
            sum(i is not None for i in images),
            len(images) - len(self._gatherer.gone(time.monotonic())),
        )
        if 2 * there < live or there == 0:
            raise InputError(f"only {there} of {live} live cameras brought an image that can be used in time")
        if isinstance(self._pipeline, DepthPipeline):
            if self._extractor is None:
                return self._pipeline.process_frame(images, moment.stamp_ns)
            return self._pipeline.process_points(self._segment(images[0], moment.stamp_ns), moment.stamp_ns)
        assert self._pipeline is not None
        return self._pipeline.process_frame(images, moment.stamp_ns)

    def _check_size(self, camera: int, image: Any) -> None:
        known = self._rig.cameras[camera].camera
        if image is not None and image.shape != (known.height, known.width):
            raise InputError(
                f"the image is {image.shape[1]} x {image.shape[0]}, "
                f"the camera's are {known.width} x {known.height}"
            )

    def _segment(self, depth: Any, stamp_ns: int) -> Any:
        """Find the person's points in a depth image, world frame."""
        camera = self._rig.cameras[0]
        cloud = self._extractor.extract(DepthFrame(stamp_ns, self._frame, depth, camera.camera))
        points = cloud.points[cloud.labels == PERSON].astype(np.float64)
        return camera.to_world(points[np.isfinite(points).all(axis=1)])

    def _publish(self, pose: VolumePose, stamp_ns: int) -> None:
        self._skeletons.publish(skeleton_to_msg(in_world(pose.skeleton, self._rig.up)))
        self.figures.counts[f"source {pose.skeleton.source.name}"] += 1
        for camera in pose.disregarded:
            self.figures.counts[f"empty silhouette: {self._rig.topics[camera]}"] += 1
            self.get_logger().warning(
                f"{self._rig.topics[camera]} shows nobody while the others do: it has no say",
                throttle_duration_sec=_LOG_EVERY_S,
            )
        if pose.skeleton.is_lost or pose.tracked is None:
            return
        self.figures.values |= {
            "confidence": pose.skeleton.confidence,
            "misfit": pose.tracked.misfit,
            "stature_m": pose.stature,
            "cameras": float(pose.volume.views),
        }
        if not self._states.get_subscription_count():
            return
        state = JointState(header=make_header(stamp_ns, self._frame), name=list(ANGLES))
        state.position = np.radians(pose.angles_deg).tolist()
        self._states.publish(state)

    # Telling

    def _tell(self) -> None:
        status = DiagnosticStatus(name=self.get_fully_qualified_name(), hardware_id="depth_pose")
        status.level, status.message = DiagnosticStatus.OK, "answers" if self.figures.rate_hz() else "waits"
        if self._pipeline is None:
            missing = ", ".join(self._source.missing())
            status.level, status.message = DiagnosticStatus.WARN, f"waits for {missing}"
            self.get_logger().warning(f"waits for {missing}", throttle_duration_sec=_LOG_EVERY_S)
        else:
            self._tell_cameras(status)
        status.values = [KeyValue(key=k, value=v) for k, v in self.figures.as_text().items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _tell_cameras(self, status: DiagnosticStatus) -> None:
        topics, gatherer = self._rig.topics, self._gatherer
        for kind, counts in (("late", gatherer.late), ("answered without", gatherer.missing)):
            for camera, count in counts.items():
                self.figures.counts[f"{kind}: {topics[camera]}"] = count
        self.figures.counts["moments overtaken"] = gatherer.overtaken
        new = self.figures.new_drops()
        if new:
            status.level = DiagnosticStatus.ERROR if new["error"] else DiagnosticStatus.WARN
            status.message = "dropped " + ", ".join(f"{n} {reason}" for reason, n in sorted(new.items()))
        gone = gatherer.gone(time.monotonic())
        if gone:
            names = ", ".join(topics[c] for c in gone)
            status.level, status.message = DiagnosticStatus.WARN, f"nothing from {names}"
        if gone != self._told_gone:
            if gone:
                self.get_logger().warning(f"nothing from {names}; goes on without")
            else:
                self.get_logger().info("all cameras are there")
            self._told_gone = gone


def _decode(message: Image, depth: bool) -> Any:
    size = (message.height, message.width, message.step, message.encoding)
    if depth:
        return decode_depth(memoryview(message.data), *size, bool(message.is_bigendian))
    return decode_silhouette(memoryview(message.data), *size)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is asked to stop; gives the exit code."""
    return run_node(VolumeNode, args)


if __name__ == "__main__":
    sys.exit(main())
