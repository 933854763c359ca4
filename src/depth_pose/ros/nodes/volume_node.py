"""Node: silhouettes of several cameras, or depth images of one or more -> pose in loose clothing.

``/depth_pose/skeleton`` (source VOLUME) in the world frame, and ``/depth_pose/joint_states`` with the
anatomical angles. Images of one moment are brought together by their stamps; a camera that is late is
not waited for longer than ``patience``, one that is gone not at all, and ``/diagnostics`` says so. The
newest moment wins.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from depth_pose_msgs.msg import Skeleton as SkeletonMsg
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import Image, JointState

from depth_pose.body.angles import ANGLES
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.types import PERSON, DepthFrame
from depth_pose.io._messages import ImageMessage
from depth_pose.io.decode import decode_depth
from depth_pose.ros.nodes.node_base import Drop, StageNode
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.setting import Setting
from depth_pose.ros.transport.conversions import make_header, skeleton_to_msg
from depth_pose.ros.transport.intake import LOG_EVERY_S, Input
from depth_pose.ros.transport.rig_source import RIG_SETTINGS, RigSource
from depth_pose.ros.transport.view_sets import MomentIntake
from depth_pose.volume.config import VolumeConfig
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.pipeline import DepthPipeline, SilhouettePipeline, VolumePose, make_pipeline
from depth_pose.volume.recordings import decode_silhouette, in_world
from depth_pose.volume.rigfile import Rig
from depth_pose.volume.synchroniser import Moment, MomentGatherer

SETTINGS: tuple[Setting, ...] = (
    Setting("model", "", "Volume model, made with 'depth-pose volume train'"),
    *RIG_SETTINGS,
    Setting("tolerance", 0.004, "Stamps that differ by at most this are of one moment [s]", 0.0, 1.0),
    Setting("patience", 0.012, "How long a moment waits for a late camera [s]", 0.0, 1.0),
    Setting("gone_after", 0.5, "A camera silent for this long is gone and not waited for [s]", 0.05, 60.0),
    Setting("cut_out", True, "Depth: find the person in the images; false: they show nothing else"),
)
"""Parameters beside those of `VolumeConfig` (``space.voxel`` and so on)."""


class VolumeNode(StageNode):
    """The volume tracker on topics."""

    CONFIG = VolumeConfig
    SECTIONS = ("segment", "denoise", "space", "track")
    SETTINGS = SETTINGS

    def __init__(self) -> None:
        self._source: RigSource | None = None
        self._told_gone: list[int] = []
        super().__init__("volume")

    # Beginning

    def prepare(self) -> None:
        """Load the model; the rest once the cameras are known."""
        if not self.value("model"):
            raise ConfigError("give the parameter model: a file that 'depth-pose volume train' made")
        try:
            self._model = VolumeModel.load(Path(self.value("model")))
            self._source = RigSource(self)
        except InputError as error:  # starting again will not help
            raise ConfigError(str(error)) from error
        self._source.listen(self._begin)

    def _begin(self, rig: Rig) -> None:
        self._rig, self._frame = rig, str(self.value("world_frame"))
        super().prepare()

    def make_stage(self, config: VolumeConfig) -> SilhouettePipeline | DepthPipeline:
        """Make the pipeline, and for depth what finds the person in each camera's images."""
        pipeline = make_pipeline(self._model, self._rig.cameras, config.space, config.track, self._frame)
        self._extractors: list[Any] = []
        if isinstance(pipeline, DepthPipeline) and self.value("cut_out"):
            from depth_pose.steps.extract import PersonExtractor

            self._extractors = [PersonExtractor(config.segment, config.denoise) for _ in pipeline.rig]
            self._extractors[0].warm_up()
        return pipeline

    def open_outputs(self) -> None:
        """Publish what other programs read: reliable, which suits every subscriber."""
        self._skeletons = self.publisher(SkeletonMsg, "skeleton", reliable=True)
        self._states = self.publisher(JointState, "joint_states", reliable=True, counted=False)

    def inputs(self) -> Sequence[Input]:
        """Listen to all cameras."""
        return [Input(Image, topic, sensor=True) for topic in self._rig.topics]

    def make_intake(self) -> MomentIntake:
        """Bring the cameras' images together."""
        topics, patience = [i.topic for i in self.inputs()], self.value("patience")
        self._gatherer = MomentGatherer(
            len(topics), self.value("tolerance"), patience, self.value("gone_after")
        )
        return MomentIntake(self, topics, self._gatherer, patience)

    # Answering

    def stamp_ns(self, *messages: Moment) -> int:
        """Give the stamp of a moment."""
        return messages[0].stamp_ns

    def answer(self, moment: Moment) -> None:
        """Track one moment."""
        images = self._decode(moment)
        there, live = sum(i is not None for i in images), len(images) - len(self._gone())
        if 2 * there < live or there == 0:
            raise Drop("bad input", f"only {there} of {live} live cameras brought a usable image in time")
        if self._extractors:
            points = [self._cut_out(c, image, moment.stamp_ns) for c, image in enumerate(images)]
            pose = self.stage.process_points(points, moment.stamp_ns)
        else:
            pose = self.stage.process_frame(images, moment.stamp_ns)
        self._publish(pose, moment.stamp_ns)

    def _gone(self) -> list[int]:
        return self._gatherer.gone(time.monotonic())

    def _decode(self, moment: Moment) -> list[Any]:
        """Give the pixels of each camera; an image that is damaged counts as missing."""
        decode = _decode_depth if isinstance(self.stage, DepthPipeline) else _decode_silhouette
        images: list[Any] = []
        for message, rig, topic in zip(moment.images, self._rig.cameras, self._rig.topics, strict=True):
            images.append(None)
            if message is None:
                continue
            try:
                if (message.height, message.width) != (rig.camera.height, rig.camera.width):
                    raise InputError(
                        f"the image is {message.width} x {message.height}, "
                        f"the camera's are {rig.camera.width} x {rig.camera.height}"
                    )
                images[-1] = decode(message)
            except InputError as error:
                self.drop("bad image", f"{topic}: {error}")
        return images

    def _cut_out(self, camera: int, depth: Any, stamp_ns: int) -> Any:
        """Find the person's points in a depth image, world frame."""
        if depth is None:
            return None
        rig = self._rig.cameras[camera]
        frame = DepthFrame(stamp_ns, self._frame, depth, rig.camera)
        cloud = self._extractors[camera].extract(frame)
        points = cloud.points[cloud.labels == PERSON].astype(np.float64)
        return rig.to_world(points[np.isfinite(points).all(axis=1)])

    def _publish(self, pose: VolumePose, stamp_ns: int) -> None:
        self._skeletons.publish(skeleton_to_msg(in_world(pose.skeleton, self._rig.up)))
        self.figures.counts[f"source {pose.skeleton.source.name}"] += 1
        for camera in pose.disregarded:
            self.figures.counts[f"shows nobody: {self._rig.topics[camera]}"] += 1
            self.get_logger().warning(
                f"{self._rig.topics[camera]} shows nobody while others do: it has no say",
                throttle_duration_sec=LOG_EVERY_S,
            )
        if pose.skeleton.is_lost or pose.tracked is None:
            return
        self.figures.values |= {
            "confidence": pose.skeleton.confidence,
            "misfit": pose.tracked.misfit,
            "stature_m": pose.stature,
            "cameras": float(pose.volume.views),
        }
        if self._states.get_subscription_count():
            state = JointState(header=make_header(stamp_ns, self._frame), name=list(ANGLES))
            state.position = np.radians(pose.angles_deg).tolist()
            self._states.publish(state)

    # Telling

    def _judge(self) -> tuple[bytes, str]:
        missing = ", ".join(self._source.missing()) if self._source is not None else ""
        if missing:
            self.get_logger().warning(f"waits for {missing}", throttle_duration_sec=LOG_EVERY_S)
            return DiagnosticStatus.WARN, f"waits for {missing}"
        if self._intake is None:
            return super()._judge()
        topics, gatherer = self._rig.topics, self._gatherer
        for kind, counts in (("late", gatherer.late), ("answered without", gatherer.missing)):
            for camera, count in counts.items():
                self.figures.counts[f"{kind}: {topics[camera]}"] = count
        level, words = super()._judge()
        if not self.is_active:
            return level, words
        gone = self._gone()
        names = ", ".join(topics[c] for c in gone)
        if gone != self._told_gone:
            self._told_gone = gone
            if gone:
                self.get_logger().warning(f"nothing from {names}; goes on without")
            else:
                self.get_logger().info("all cameras are there")
        return (DiagnosticStatus.WARN, f"nothing from {names}") if gone else (level, words)


def _decode_silhouette(image: ImageMessage) -> Any:
    return decode_silhouette(image.data, image.height, image.width, image.step, image.encoding)


def _decode_depth(image: ImageMessage) -> Any:
    size = (image.height, image.width, image.step, image.encoding)
    return decode_depth(image.data, *size, bool(image.is_bigendian))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is asked to stop; gives the exit code."""
    return run_node(VolumeNode, args)


if __name__ == "__main__":
    sys.exit(main())
