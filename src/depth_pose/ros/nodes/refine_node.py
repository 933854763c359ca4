"""Node: people and matches -> fitted bodies, ``/depth_pose/skeletons_refined``, and ``mesh``."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from depth_pose_msgs.msg import Packed
from visualization_msgs.msg import Marker

from depth_pose.body.build_file import load_build
from depth_pose.body.pose import Fitted
from depth_pose.core.config import PipelineConfig
from depth_pose.core.mount import check_upright
from depth_pose.refine.refine import Refiner
from depth_pose.ros.messages.fits import fitted_to_msg
from depth_pose.ros.messages.matches import msg_to_matches
from depth_pose.ros.nodes.bank_node import BankNode
from depth_pose.ros.nodes.node_base import Input
from depth_pose.ros.nodes.parameters import REFINE
from depth_pose.ros.process.runner import run_node
from depth_pose.ros.transport.drawing import mesh_to_marker
from depth_pose.stages import StageFactory
from depth_pose.track.person_view import FramePeople


class RefineNode(BankNode):
    """Fits the body to the points, from the matched exemplars (Sec. 6)."""

    LOGS_BUSY = False
    SECTIONS = ("mount", "refine", "build")
    SETTINGS = REFINE

    def __init__(self) -> None:
        self._next_mesh_s = 0.0
        super().__init__("refine")

    def make_stage(self, config: PipelineConfig) -> Refiner:
        """Build the refiner."""
        return StageFactory(self.bank, config).make_refiner()

    def check_config(self, config: PipelineConfig, changes: Mapping[str, Any]) -> None:
        """Refuse a build that cannot be read."""
        if changes.get("build"):
            load_build(config.build.file)

    def open_outputs(self) -> None:
        """Create the publishers of the fitted bodies, and of their meshes for subscribers."""
        self._fitted = self.publisher(Packed, "skeletons_refined")
        self._meshes = self.publisher(Marker, "mesh", reliable=True, counted=False)

    def inputs(self) -> Sequence[Input]:
        """Subscribe to the people with their matches."""
        return [Input(Packed, "match")]

    def answer(self, message: Packed) -> None:
        """Fit the people of one frame."""
        people, matches = msg_to_matches(message)
        check_upright(people.frame_id, self.config.mount)
        fitted = self.stage.refine(people, matches)
        self._fitted.publish(fitted_to_msg(fitted, people))
        self.statistics.values["people"] = len(fitted)
        for f in fitted[:1]:
            self.statistics.values["score"] = f.score
            self.statistics.values["residual_m"] = f.mean_depth_error
        self._publish_meshes(fitted, people)

    def _publish_meshes(self, fitted: Sequence[Fitted], people: FramePeople) -> None:
        """Publish the fitted meshes, at most ``mesh_rate`` times a second."""
        rate, now = self.value("mesh_rate"), time.monotonic()
        if rate <= 0.0 or now < self._next_mesh_s or not self._meshes.get_subscription_count():
            return
        bodies = [f.body for f in fitted if f.body is not None]
        if bodies:
            self._next_mesh_s = now + 1.0 / rate
        for number, body in enumerate(bodies):
            faces = self.bank.body.faces
            self._meshes.publish(
                mesh_to_marker(body.vertices, faces, people.stamp_ns, people.frame_id, number)
            )


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a stop signal; return the exit code."""
    return run_node(RefineNode, args)


if __name__ == "__main__":
    sys.exit(main())
