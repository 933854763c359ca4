"""Node: points and fitted skeleton -> final ``/depth_pose/skeleton``, ``markers`` and ``/tf``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from depth_pose_msgs.msg import Skeleton
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import ConfigError
from depth_pose.ros.nodes.bank_node import BankNode
from depth_pose.ros.nodes.node_base import Input
from depth_pose.ros.nodes.parameters import RECOVERY
from depth_pose.ros.nodes.warm_stages import make
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.transport.conversions import msg_to_cloud, msg_to_skeleton, skeleton_to_msg
from depth_pose.ros.transport.drawing import skeleton_to_markers, skeleton_to_transforms
from depth_pose.steps.mount import turn_back
from depth_pose.steps.recover import Recoverer


class RecoveryNode(BankNode):
    """Finds failures, recovers from them over time, and smooths (Sec. 6, last part)."""

    SECTIONS = ("mount", "recover", "smooth", "fit", "cpd", "completion", "temporal")
    SETTINGS = RECOVERY

    def __init__(self) -> None:
        super().__init__("recovery")

    def make_stage(self, config: PipelineConfig) -> Recoverer:
        """Make the recoverer."""
        return make(Recoverer, self.bank, config.recover, config.smooth, config.fitting)

    def open_outputs(self) -> None:
        """Publish what other programs read: reliable, which suits every subscriber."""
        self._skeletons = self.publisher(Skeleton, "skeleton", reliable=True)
        self._markers = self.publisher(MarkerArray, "markers", reliable=True, counted=False)
        self._transforms = None
        if self.value("tf"):
            message = _tf_message()
            self._transforms = self.create_publisher(message, "/tf", 10)
            self._tf_message = message

    def inputs(self) -> Sequence[Input]:
        """Pair the points with their fitted skeleton."""
        return [Input(PointCloud2, "points"), Input(Skeleton, "skeleton_refined")]

    def answer(self, points: PointCloud2, refined: Skeleton) -> None:
        """Check, recover and smooth one frame."""
        upright = self.stage.recover(msg_to_cloud(points), msg_to_skeleton(refined))
        skeleton = turn_back(upright, self.config.mount)
        self._skeletons.publish(skeleton_to_msg(skeleton))
        if self._markers.get_subscription_count():
            self._markers.publish(skeleton_to_markers(skeleton))
        if self._transforms is not None:
            transforms = skeleton_to_transforms(skeleton, self.value("tf_prefix"))
            self._transforms.publish(self._tf_message(transforms=transforms))
        self.figures.counts[f"source {skeleton.source.name}"] += 1
        self.figures.values["confidence"] = skeleton.confidence
        self.figures.values["residual_m"] = skeleton.residual
        self.figures.values["recoveries"] = self.stage.recoveries
        for kind, count in self.stage.failures.items():
            self.figures.values[f"failures {kind}"] = count


def _tf_message() -> Any:
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError as e:
        raise ConfigError(
            "parameter tf is true, but the package tf2_msgs is not installed; it comes with apt's "
            "ros-jazzy-tf2-msgs"
        ) from e
    return TFMessage


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is asked to stop; gives the exit code."""
    return run_node(RecoveryNode, args)


if __name__ == "__main__":
    sys.exit(main())
