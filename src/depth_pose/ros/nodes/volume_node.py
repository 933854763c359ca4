"""Node: silhouettes of several cameras, or depth images of one or more -> pose in loose clothing.

``/depth_pose/skeleton`` (source VOLUME) in the world frame, ``/depth_pose/markers`` for viewers, and
``/depth_pose/joint_states`` with the anatomical angles. Images of one time are grouped by their
stamps; the node waits for a late camera at most ``views.patience``, for a lost one not at all,
and ``/diagnostics`` reports it. The newest set of views wins.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from depth_pose_msgs.msg import Skeleton as SkeletonMsg
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import Image, JointState
from visualization_msgs.msg import MarkerArray

from depth_pose.body.angles import ANGLES
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.io.skeleton_cdr import write_skeleton
from depth_pose.rooms.rigfile import Rig
from depth_pose.ros.messages.basics import make_header
from depth_pose.ros.nodes.node_base import Drop, StageNode
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.setting import Setting
from depth_pose.ros.transport.drawing import skeletons_to_markers
from depth_pose.ros.transport.intake import LOG_EVERY_S, Input
from depth_pose.ros.transport.rig_source import RIG_SETTINGS, RigSource
from depth_pose.ros.transport.view_sets import ViewSetIntake
from depth_pose.volume.config import VolumeConfig
from depth_pose.volume.decode import ViewDecoder
from depth_pose.volume.model import VolumeModel
from depth_pose.volume.pipeline import VolumePipeline, VolumePose
from depth_pose.volume.synchroniser import Synchroniser, ViewSet

SETTINGS: tuple[Setting, ...] = (
    Setting("model", "", "Volume model, made with 'depth-pose volume train'"),
    *RIG_SETTINGS,
)
"""Parameters besides those of `VolumeConfig` (``space.voxel`` and so on)."""


class VolumeNode(StageNode):
    """The volume tracker on topics."""

    CONFIG = VolumeConfig
    SECTIONS = ("segment", "denoise", "views", "space", "track")
    SETTINGS = SETTINGS

    def __init__(self) -> None:
        self._source: RigSource | None = None
        self._reported_gone: list[int] = []
        self._reported_unit: set[str] = set()
        super().__init__("volume")

    # Beginning

    def prepare(self) -> None:
        """Load the model; the pipeline is built once the cameras are known."""
        if not self.value("model"):
            raise ConfigError("give the parameter model: a file that 'depth-pose volume train' made")
        try:
            self._model = VolumeModel.load(Path(self.value("model")))
            self._source = RigSource(self)
        except InputError as error:  # a restart would not help
            raise ConfigError(str(error)) from error
        self._source.listen(self._begin)

    def _begin(self, rig: Rig) -> None:
        self._rig, self._frame = rig, str(self.value("world_frame"))
        self._synchroniser = Synchroniser(len(rig.topics))
        super().prepare()

    def make_stage(self, config: VolumeConfig) -> VolumePipeline:
        """Build the pipeline."""
        self._synchroniser.config = config.views
        kind = self._model.meta["input"]
        self._decoder = ViewDecoder(self._rig, kind, config.views.depth_scale, self._complain)
        return VolumePipeline(self._model, self._rig, config, self._frame)

    def open_outputs(self) -> None:
        """Create the publishers for other programs: reliable, which suits every subscriber."""
        self._skeletons = self.publisher(SkeletonMsg, "skeleton", reliable=True)
        self._markers = self.publisher(MarkerArray, "markers", reliable=True, counted=False)
        self._states = self.publisher(JointState, "joint_states", reliable=True, counted=False)

    def inputs(self) -> Sequence[Input]:
        """Subscribe to all cameras."""
        return [Input(Image, topic, sensor=True) for topic in self._rig.topics]

    def make_intake(self) -> ViewSetIntake:
        """Group the cameras' images."""
        return ViewSetIntake(self, self._rig.topics, self._synchroniser)

    # Answering

    def stamp_ns(self, *messages: ViewSet) -> int:
        """Return the stamp of a set of views."""
        return messages[0].stamp_ns

    def answer(self, messages: ViewSet) -> None:
        """Track the views of one time."""
        try:
            views = self._decoder.decode(messages, len(self._gone()))
        except InputError as error:
            raise Drop("bad input", str(error)) from error
        for topic, line in self._decoder.doubts(live=True).items():
            if topic not in self._reported_unit:
                self._reported_unit.add(topic)
                self.get_logger().warning(line)
        self._publish(self.stage.process_frame(views), views.stamp_ns)

    def _complain(self, topic: str, error: InputError) -> None:
        self.drop("bad image", f"{topic}: {error}")

    def _gone(self) -> list[int]:
        return self._synchroniser.gone(time.monotonic())

    def _publish(self, pose: VolumePose, stamp_ns: int) -> None:
        self._skeletons.publish(write_skeleton(pose.skeleton))
        if self._markers.get_subscription_count():
            shown = [] if pose.skeleton.is_lost else [pose.skeleton]
            self._markers.publish(skeletons_to_markers(shown, stamp_ns, self._frame))
        self.statistics.counts[f"source {pose.skeleton.source.name}"] += 1
        for camera in pose.disregarded:
            self.statistics.counts[f"shows nobody: {self._rig.topics[camera]}"] += 1
            self.get_logger().warning(
                f"{self._rig.topics[camera]} shows nobody while others do: it is ignored",
                throttle_duration_sec=LOG_EVERY_S,
            )
        if pose.skeleton.is_lost or pose.tracked is None:
            return
        self.statistics.values |= {
            "confidence": pose.skeleton.confidence,
            "misfit": pose.tracked.misfit,
            "stature_m": pose.stature,
            "cameras": float(pose.volume.views),
        }
        if self._states.get_subscription_count():
            state = JointState(header=make_header(stamp_ns, self._frame), name=list(ANGLES))
            state.position = np.radians(pose.angles_deg).tolist()
            self._states.publish(state)

    # Diagnostics

    def judge(self) -> tuple[bytes, str]:
        """Return level and text: missing parts of the rig, cameras without views, else the usual ones."""
        missing = ", ".join(self._source.missing()) if self._source is not None else ""
        if missing:
            self.get_logger().warning(f"waits for {missing}", throttle_duration_sec=LOG_EVERY_S)
            return DiagnosticStatus.WARN, f"waits for {missing}"
        if self.intake is None:
            return super().judge()
        topics, held = self._rig.topics, self._synchroniser
        for kind, counts in (("late", held.late), ("answered without", held.missing)):
            for camera, count in counts.items():
                self.statistics.counts[f"{kind}: {topics[camera]}"] = count
        level, words = super().judge()
        if not self.is_active:
            return level, words
        gone = self._gone()
        names = ", ".join(topics[c] for c in gone)
        if gone != self._reported_gone:
            self._reported_gone = gone
            if gone:
                self.get_logger().warning(f"nothing from {names}; goes on without")
            else:
                self.get_logger().info("all cameras are there")
        return (DiagnosticStatus.WARN, f"nothing from {names}") if gone else (level, words)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a stop signal; return the exit code."""
    return run_node(VolumeNode, args)


if __name__ == "__main__":
    sys.exit(main())
