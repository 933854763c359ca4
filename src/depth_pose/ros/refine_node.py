"""Node: points and match -> fitted skeleton, ``/depth_pose/skeleton_refined``, and its ``mesh``."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from depth_pose_msgs.msg import PoseMatch, Skeleton
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from depth_pose.config import PipelineConfig
from depth_pose.ros.bank_node import BankNode
from depth_pose.ros.conversions import msg_to_cloud, msg_to_match, skeleton_to_msg
from depth_pose.ros.drawing import mesh_to_marker
from depth_pose.ros.node_base import Input
from depth_pose.ros.parameters import REFINE
from depth_pose.ros.runner import run_node
from depth_pose.steps.refine import Refiner


class RefineNode(BankNode):
    """Fits the body to the points, from the matched exemplars (Sec. 6)."""

    SECTIONS = ("refine", "match")
    SETTINGS = REFINE

    def __init__(self) -> None:
        self._next_mesh_s = 0.0
        super().__init__("refine")

    def make_stage(self, config: PipelineConfig) -> Refiner:
        """Make the refiner."""
        return Refiner(self.bank, config.refine, config.match)

    def open_outputs(self) -> None:
        """Publish the skeleton, and the mesh while somebody listens."""
        self._skeletons = self.publisher(Skeleton, "skeleton_refined")
        self._meshes = self.publisher(Marker, "mesh", reliable=True, counted=False)

    def inputs(self) -> Sequence[Input]:
        """Pair the points with their match."""
        return [Input(PointCloud2, "points"), Input(PoseMatch, "match")]

    def answer(self, points: PointCloud2, match: PoseMatch) -> None:
        """Fit one frame."""
        cloud = msg_to_cloud(points)
        skeleton = self.stage.refine(cloud, msg_to_match(match))
        self._skeletons.publish(skeleton_to_msg(skeleton))
        self.figures.values["confidence"] = skeleton.confidence
        self.figures.values["residual_m"] = skeleton.residual
        self._publish_mesh(cloud.stamp_ns, cloud.frame_id)

    def _publish_mesh(self, stamp_ns: int, frame_id: str) -> None:
        rate, now = self.value("mesh_rate"), time.monotonic()
        if rate <= 0.0 or now < self._next_mesh_s or not self._meshes.get_subscription_count():
            return
        vertices = self.stage.mesh
        if vertices is not None:
            self._next_mesh_s = now + 1.0 / rate
            self._meshes.publish(mesh_to_marker(vertices, self.bank.body.faces, stamp_ns, frame_id))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is asked to stop; gives the exit code."""
    return run_node(RefineNode, args)


if __name__ == "__main__":
    sys.exit(main())
